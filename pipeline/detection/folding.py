"""Weights that an old exporter listed as inputs too are made constants, so that the runtime can fuse them.

Done on the wire form: of the graph (field 7 of the model) those inputs (field 11) go whose names are those of
initialisers (field 5).
"""

from __future__ import annotations

from pipeline.detection.wire import BYTES, fields

_GRAPH, _INITIALIZER, _INPUT = 7, 5, 11
_TENSOR_NAME, _VALUE_NAME = 8, 1


def folded(model: bytes) -> bytes:
    """The model without the inputs that are initialisers. Raises ValueError for bytes that are no model."""
    parts = []
    for number, content, whole in fields(model):
        if number == _GRAPH and content is not None:
            graph = _graph(content)
            parts.append(_key(_GRAPH) + _varint(len(graph)) + graph)
        else:
            parts.append(whole)
    return b"".join(parts)


def _graph(graph: bytes) -> bytes:
    parts = list(fields(graph))
    weights = {_name(content, _TENSOR_NAME) for number, content, _ in parts if number == _INITIALIZER}
    kept = (
        whole
        for number, content, whole in parts
        if number != _INPUT or _name(content, _VALUE_NAME) not in weights
    )
    return b"".join(kept)


def _name(message: bytes | None, field: int) -> bytes:
    return next((content or b"" for number, content, _ in fields(message or b"") if number == field), b"")


def _key(field: int) -> bytes:
    return _varint(field << 3 | BYTES)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)
