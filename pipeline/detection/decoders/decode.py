"""The decoder of a layout."""

from __future__ import annotations

from pipeline.config.layout import Anchors, Cells, Chosen, Distances, Layout, Pairs, Rows
from pipeline.detection.decoders.anchors import decode_anchors
from pipeline.detection.decoders.candidates import Candidates, Groups, Outputs
from pipeline.detection.decoders.cells import decode_cells
from pipeline.detection.decoders.chosen import decode_chosen
from pipeline.detection.decoders.distances import decode_distances
from pipeline.detection.decoders.pairs import decode_pairs
from pipeline.detection.decoders.rows import decode_rows


def decode(
    outputs: Outputs, size: tuple[int, int], layout: Layout, groups: Groups, least: float
) -> Candidates:
    """Candidates of one picture.

    outputs: of one picture, without the batch axis, by name. size: width and height of the input, pixels.
    groups: classes that are asked for. Candidates with scores below ``least`` are left out, NaN is not.
    Raises ValueError or IndexError if the outputs do not have the shapes that the layout says.
    """
    match layout.output:
        case Rows() as kind:
            return decode_rows(outputs, size, kind, groups, least)
        case Pairs() as kind:
            return decode_pairs(outputs, size, kind, groups, least)
        case Chosen() as kind:
            return decode_chosen(outputs, size, kind, groups, least)
        case Distances() as kind:
            return decode_distances(outputs, size, kind, groups, least)
        case Anchors() as kind:
            return decode_anchors(outputs, size, kind, groups, least)
        case Cells() as kind:
            return decode_cells(outputs, size, kind, groups, least)
