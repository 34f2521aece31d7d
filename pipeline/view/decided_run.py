"""What is handed over carries what was decided: a rejected place is not sent as if nobody had looked at it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pipeline.geo.frame import LocalFrame
from pipeline.outputs.exports.view import Place as ExportedPlace
from pipeline.outputs.exports.view import RunView, State
from pipeline.view.decisions import Decision, read_log
from pipeline.view.files import FOUND, POSSIBLE
from pipeline.view.places import Place, places_of, with_decisions

_WORDS = {"confirm": "confirmed", "reject": "rejected", "note": "noted"}


def with_decided(view: RunView, run: Path) -> tuple[RunView, tuple[str, ...]]:
    """The run with the decisions of its directory, and a sentence for each whose place is not there (any more).

    Probabilities are those after the decisions; the most probable come first, those found before those possible.
    """
    log = read_log(run)
    if not view.places or not log.standing:
        return view, tuple(_lost(decision) for decision in log.standing)
    first = view.places[0]
    frame = LocalFrame(first.latitude_deg, first.longitude_deg)
    found, possible = ((run / name).read_bytes() for name in (FOUND, POSSIBLE))
    places, lost = with_decisions(places_of(found, possible, None, frame), log.standing, frame)
    by_id = {place.id: place for place in places if place.decisions}
    decided = [_decided(place, by_id[place.id]) if place.id in by_id else place for place in view.places]
    return replace(view, places=_ranked(decided)), tuple(_lost(decision) for decision in lost)


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


def _ranked(places: Sequence[ExportedPlace]) -> tuple[ExportedPlace, ...]:
    ordered = sorted(places, key=lambda p: (p.kind == "possible", -p.probability, p.id))
    return tuple(replace(place, rank=rank) for rank, place in enumerate(ordered, start=1))


def _sentence(decision: Decision) -> str:
    text = f": {decision.text}" if decision.text else ""
    return f"{_WORDS[decision.kind]} by {decision.who}, {decision.at}{text}"


def _lost(decision: Decision) -> str:
    where = f"{decision.latitude_deg:.6f}, {decision.longitude_deg:.6f}"
    return f"decision {decision.number} ({_sentence(decision)}) is about a place at {where} that is not there any more"
