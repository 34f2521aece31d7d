from __future__ import annotations

import sys

import pytest

from pipeline.storage.code_digest import code_sha256


@pytest.fixture
def package(tmp_path, monkeypatch):
    folder = tmp_path / "made_up_package"
    (folder / "inner").mkdir(parents=True)
    for name in ("__init__.py", "one.py", "inner/__init__.py", "inner/two.py"):
        (folder / name).write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    for name in [name for name in sys.modules if name.startswith("made_up_package")]:
        del sys.modules[name]
    code_sha256.cache_clear()


def digest(*names: str) -> str:
    code_sha256.cache_clear()
    return code_sha256(*names)


def test_any_change_in_a_package_changes_its_digest(package):
    before = digest("made_up_package")
    assert digest("made_up_package") == before
    for name in ("one.py", "inner/two.py", "new.py"):
        (package / name).write_text("x = 2\n")
        after = digest("made_up_package")
        assert after != before
        before = after


def test_a_module_stands_for_itself_alone(package):
    before = digest("made_up_package.one"), digest("made_up_package.inner.two", "made_up_package.one")
    (package / "inner/two.py").write_text("x = 2\n")
    assert digest("made_up_package.one") == before[0]
    assert digest("made_up_package.inner.two", "made_up_package.one") != before[1]


def test_the_order_of_names_does_not_count_and_an_unknown_name_is_an_error(package):
    one, two = "made_up_package.one", "made_up_package.inner.two"
    assert digest(one, two) == digest(two, one)
    with pytest.raises(ModuleNotFoundError):
        digest("made_up_package.three")
