"""What is handed over carries what was decided: a rejected place is not sent as if nobody had looked at it."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from pipeline.geo.frame import LocalFrame
from pipeline.outputs.exports.decided_cells import Shift
from pipeline.outputs.exports.view import Place as ExportedPlace
from pipeline.outputs.exports.view import RunView, State, ranked
from pipeline.view.decisions import WEIGHT, Decision, read_log
from pipeline.view.places import Place, with_decisions

_WORDS = {"confirm": "confirmed", "reject": "rejected", "note": "noted"}


def with_decided(view: RunView, run: Path) -> tuple[RunView, tuple[str, ...]]:
    """The run with the decisions of its directory, and a sentence for each whose place is not there (any more).

    Probabilities are those after the decisions; the most probable come first, those found before those possible.
    """
    standing = read_log(run).standing
    if not view.places or not standing:
        return view, tuple(_lost(decision) for decision in standing)
    frame = LocalFrame(view.places[0].latitude_deg, view.places[0].longitude_deg)
    places, lost = with_decisions([_shown(place, frame) for place in view.places], standing, frame)
    by_id = {place.id: place for place in places if place.decisions}
    decided = (_decided(place, by_id[place.id]) if place.id in by_id else place for place in view.places)
    shifts = tuple(_shift(place) for place in places if place.net)
    return replace(view, places=ranked(decided), shifts=shifts), tuple(_lost(decision) for decision in lost)


def _shift(place: Place) -> Shift:
    return Shift(
        place.class_name, place.latitude_deg, place.longitude_deg, *place.semi_axes_m, place.net * WEIGHT
    )


def _shown(place: ExportedPlace, frame: LocalFrame) -> Place:
    """As the view has it, to which decisions belong."""
    east, north = frame.enu_from_wgs84(np.array(place.latitude_deg), np.array(place.longitude_deg))
    ellipse = {} if place.error is None else {"error_ellipse": asdict(place.error)}
    at = place.latitude_deg, place.longitude_deg, float(east), float(north)
    return Place(place.id, place.kind, place.class_name, place.probability, *at, ellipse)


def _decided(exported: ExportedPlace, place: Place) -> ExportedPlace:
    people = exported.expected_people / exported.probability if exported.probability > 0.0 else 1.0
    state: State = ""
    if place.conflict:
        state = "contradicted"
    elif place.net != 0:
        state = "confirmed" if place.net > 0 else "rejected"
    return replace(
        exported,
        probability=place.decided,
        expected_people=place.decided * people,
        state=state,
        decided=tuple(_sentence(decision) for decision in place.decisions),
    )


def _sentence(decision: Decision) -> str:
    text = f": {decision.text}" if decision.text else ""
    return f"{_WORDS[decision.kind]} by {decision.who}, {decision.at}{text}"


def _lost(decision: Decision) -> str:
    where = f"{decision.latitude_deg:.6f}, {decision.longitude_deg:.6f}"
    return f"decision {decision.number} ({_sentence(decision)}) is about a place at {where} that is not there any more"
