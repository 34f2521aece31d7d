"""The ``layout:`` section of a pool, as text: whole, or filled in as far as could be seen."""

from __future__ import annotations

from typing import Any

import yaml

from pipeline.config.layout import Layout
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input


def section_of(facts: Facts, proposal: Proposal | None) -> str:
    """The ``layout:`` section for the pool as YAML, as far as it is known; the rest is marked with ?."""
    if proposal is not None:
        return layout_yaml(proposal.layout)
    picture = picture_input(facts).model_dump(mode="json", exclude_none=True)
    unknown = {"colour": "?", "range": "?", "placement": "?"}
    shown = ", ".join(f"{t.name} {list(facts.shapes[t.name])}" for t in facts.signature.outputs)
    document: dict[str, Any] = {"input": picture | unknown}
    if facts.others:
        document["sizes"] = [{"tensor": t.name, "value": "?"} for t in facts.others]
    document["output"] = _guessed_output(facts)
    text = yaml.safe_dump({"layout": document}, sort_keys=False, default_flow_style=None, allow_unicode=True)
    kinds = "# kinds of output: rows, pairs, chosen, distances, anchors, cells; ? is to be filled in"
    return f"# outputs: {shown}\n{kinds}\n{text.rstrip()}"


def _guessed_output(facts: Facts) -> dict[str, Any]:
    """What the shapes of the outputs look like most."""
    outputs = facts.outputs
    if len(outputs) == 1 and len(outputs[0].shape) >= 2:
        high, wide = outputs[0].shape[-2:]
        order = "rows" if int(high or 0) >= int(wide or 0) else "columns"
        return {"kind": "rows", "tensor": outputs[0].name, "order": order, "box": "?", "objectness": "?"}
    boxes = [t.name for t in outputs if t.shape[-1:] == (4,)]
    if len(outputs) == 2 and len(boxes) == 1:
        (scores,) = (t.name for t in outputs if t.name not in boxes)
        unknown = {"box": "?", "unit": "?", "activation": "?"}
        return {"kind": "pairs", "boxes": boxes[0], "scores": scores} | unknown
    return {"kind": "?", "tensors": [t.name for t in outputs]}


def layout_yaml(layout: Layout) -> str:
    """A layout as the pool has it."""
    document = {"layout": layout.model_dump(mode="json", exclude_none=True)}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, allow_unicode=True).rstrip()
