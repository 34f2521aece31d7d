"""No module imports another one in a circle, however long: each can be read, and tested, after those below it."""

import grimp
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def circles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other, directly or not."""
    modules = sorted(imports)
    number = {module: k for k, module in enumerate(modules)}
    pairs = np.array(
        [(number[a], number[b]) for a in modules for b in imports[a] if b in number], dtype=np.int64
    ).reshape(-1, 2)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(modules),) * 2)
    _, labels = connected_components(links, directed=True, connection="strong")
    groups = [[modules[i] for i in np.flatnonzero(labels == k)] for k in np.unique(labels)]
    return [group for group in groups if len(group) > 1]


def test_circles_of_any_length_are_seen() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert circles({"a": {"b"}, "b": {"a"}}) == [["a", "b"]]
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"d"}, "d": {"b"}, "e": {"a"}}) == [["b", "c", "d"]]


def test_no_module_imports_another_one_in_a_circle() -> None:
    graph = grimp.build_graph("pipeline", "actors", exclude_type_checking_imports=True, cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    assert len(imports) > 300
    assert circles(imports) == []
