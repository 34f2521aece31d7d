"""What the graph of a model shows that its outputs do not."""

from __future__ import annotations

import struct

from pipeline.detection.wire import fields, read_varint

_GRAPH = 7
_NODE, _WEIGHT = 1, 5
_INPUT, _OUTPUT, _OPERATOR, _ATTRIBUTE = 1, 2, 4, 5
_DIMS, _INT64S, _NAME, _RAW = 1, 7, 8, 9


def class_count(model: bytes) -> int | None:
    """How many classes a network tells apart that gives labels: by what it divides the places of its TopK.

    The DETR family chooses the best of queries x classes; the label is the rest of the place divided by the
    classes. None where the graph shows no such number, or several, or is not readable.
    """
    try:
        graph = next(content for number, content, _ in fields(model) if number == _GRAPH and content)
        return _divisor(graph)
    except (ValueError, StopIteration, struct.error):
        return None


def _divisor(graph: bytes) -> int | None:
    whole: dict[bytes, int] = {}
    found: set[int] = set()
    for number, content, _ in fields(graph):
        if number == _WEIGHT and content is not None:
            name, value = _scalar(content)
            if value is not None:
                whole[name] = value
    for number, content, _ in fields(graph):
        if number != _NODE or content is None:
            continue
        node = [(n, c) for n, c, _ in fields(content) if c is not None]
        operator = next((c for n, c in node if n == _OPERATOR), b"")
        inputs = [c for n, c in node if n == _INPUT]
        if operator == b"Constant":
            output = next((c for n, c in node if n == _OUTPUT), b"")
            for tensor in (t for n, c in node if n == _ATTRIBUTE for k, t, _ in fields(c) if k == 5 and t):
                value = _scalar(tensor)[1]
                if value is not None:
                    whole[output] = value
        elif operator == b"TopK":
            found = set()  # an earlier one chooses queries, the last one objects
        elif operator in (b"Div", b"Mod"):
            found |= {whole[name] for name in inputs if name in whole and whole[name] > 1}
    return found.pop() if len(found) == 1 else None


def _scalar(tensor: bytes) -> tuple[bytes, int | None]:
    """Name and value of an int64 tensor without axes or of one value, None for others."""
    name, value, dims = b"", None, 1
    kind = None
    at_kind = 2
    for number, content, whole in fields(tensor):
        if number == _NAME and content is not None:
            name = content
        elif number == _DIMS:
            dims *= read_varint(whole, 1)[0] if content is None else 1
        elif number == at_kind and content is None:
            kind = read_varint(whole, 1)[0]
        elif number == _RAW and content is not None and len(content) == 8:
            value = struct.unpack("<q", content)[0]
        elif number == _INT64S:
            value = read_varint(content, 0)[0] if content else (read_varint(whole, 1)[0] if whole else None)
    return name, value if kind == 7 and dims == 1 else None
