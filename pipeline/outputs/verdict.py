"""What a run says in one sentence, and why it may not be believed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pipeline.fusion.salient import SalientLocation
from pipeline.ingest.finding import Finding
from pipeline.outputs.partial import Partial
from pipeline.outputs.truth import TruthMatch
from pipeline.second_look.coverage import Coverage

Kind = Literal["found", "nobody_found", "nobody_looked", "cannot_be_trusted"]

#: a map is not believed if one reason refused more than this share of the boxes, and at least so many
_MOST_REFUSED, _LEAST_BOXES = 0.5, 20
#: reasons that a good map has too: a box at the border is seen whole in the next picture
_HARMLESS = frozenset({"cut by the picture's border"})
#: findings that say that places are wrong, not only less sure
_WRONG_PLACES = frozenset(
    [
        "clock_off",
        "heading_off",
        "height_off",
        "focal_length",
        "pitch_sign",
        "exchanged",
        "other_flight",
        "frozen",
        "units",
        "duration",
    ]
)
#: what usually makes a reason so frequent
_LIKELY = {
    "not the size of its class, or no trust": "heights, focal length, or the scores of the detector",
    "no ground within reach": "pitch, heights, or the surface model",
    "no voxel": "heading, position, or a surface model that is too small",
    "pose outside the terrain": "position, or a surface model that is too small",
    "pose under the ground": "heights above different datums",
    "class without a layer": "the detector's classes",
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """kind, sentence: for the head of every output. reasons: refused evidence, reason -> count. boxes: in all.

    doubts: why the map cannot be trusted, see ``doubts_of``.
    """

    kind: Kind
    sentence: str
    reasons: Mapping[str, int]
    boxes: int
    doubts: Mapping[str, int]


def judge(
    locations: Sequence[SalientLocation],
    match: TruthMatch | None,
    not_taken: Mapping[str, int],
    boxes: int,
    findings: Sequence[Finding] = (),
    *,
    possible: Sequence[SalientLocation] = (),
    coverage: Coverage | None = None,
    partial: Partial | None = None,
) -> Verdict:
    """boxes: reported by all detectors. not_taken: what of them the map did not take, reason -> count.

    possible: places below the threshold. coverage: of the ground that was to be searched; None: not known. partial:
    of a run that ended too early: the sentence begins with it.
    """
    doubt = _doubt(not_taken, boxes) or _wrong_places(findings)
    blind = coverage is not None and coverage.seen_m2 == 0.0
    kind: Kind = (
        "cannot_be_trusted"
        if doubt
        else "found"
        if locations
        else "nobody_looked"
        if blind
        else "nobody_found"
    )
    if doubt:
        sentence = f"This map cannot be trusted, because {doubt}."
    elif kind == "nobody_looked":
        sentence = "Nobody looked: no picture showed any ground of the map, so nothing is known."
    else:
        said = [_found(locations, match), *_besides(possible, bool(locations))]
        sentence = " ".join([*said, *_left_out(coverage, bool(locations) or match is not None)])
    if partial is not None:
        sentence = f"{partial.sentence} {sentence}"
    return Verdict(kind, sentence, dict(not_taken), boxes, doubts_of(not_taken, boxes, findings))


def doubts_of(not_taken: Mapping[str, int], boxes: int, findings: Sequence[Finding] = ()) -> dict[str, int]:
    """Reasons not to trust a map, by a code of lower case letters; empty if there is none.

    ``boxes_refused_..``: how many boxes were refused for it. The cause of a finding that says that places are wrong:
    how many there are.
    """
    found: dict[str, int] = {}
    refused = _most_refused(not_taken, boxes)
    if refused is not None:
        found[f"boxes_refused_{_code(refused[0])}"] = refused[1]
    for finding in findings:
        if _is_of_places(finding):
            code = _code(finding.cause)
            found[code] = found.get(code, 0) + 1
    return found


def _code(words: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", words.lower()).strip("_")


def _besides(possible: Sequence[SalientLocation], found: bool) -> list[str]:
    if not possible:
        return []
    count = _count(len(possible), "possible place")
    return [
        f"{count} below the threshold {'is' if len(possible) == 1 else 'are'} listed{' apart' if found else ''}."
    ]


def _left_out(coverage: Coverage | None, known: bool) -> list[str]:
    """What nobody looked at; what is not said in square metres is said in words."""
    if coverage is not None:
        return [*coverage.sentences, *([coverage.success] if coverage.success else [])]
    return [] if known else ["Ground that was not looked at may still hide a person."]


def _most_refused(not_taken: Mapping[str, int], boxes: int) -> tuple[str, int] | None:
    """The reason for which most boxes were refused, and how many, if that is not usual."""
    refused = {reason: count for reason, count in not_taken.items() if reason not in _HARMLESS}
    if not refused:
        return None
    reason, count = max(refused.items(), key=lambda item: item[1])
    if count < _LEAST_BOXES or count <= _MOST_REFUSED * max(boxes, count):
        return None
    return reason, count


def _doubt(not_taken: Mapping[str, int], boxes: int) -> str | None:
    most = _most_refused(not_taken, boxes)
    if most is None:
        return None
    reason, count = most
    likely = f" (look at {_LIKELY[reason]})" if reason in _LIKELY else ""
    return f"{count:,} of {max(boxes, count):,} boxes were refused: {reason}{likely}"


def _wrong_places(findings: Sequence[Finding]) -> str | None:
    for finding in findings:
        if _is_of_places(finding):
            return f"{finding.where.rpartition('/')[2]}: {finding.found}"
    return None


def _is_of_places(finding: Finding) -> bool:
    return finding.severity == "warning" and bool(set(finding.cause.split("/")) & _WRONG_PLACES)


def _found(locations: Sequence[SalientLocation], match: TruthMatch | None) -> str:
    """One sentence: how many people were found, and how well, if that is known."""
    if match is None:
        if not locations:
            return "No place reached the threshold."
        best = max(place.probability for place in locations)
        return f"{_count(len(locations), 'place')} where a person is likely; the most probable at {best:.0%}."
    sentence = f"{len(match.found)} of {_count(match.people, 'person', 'people')} found"
    if match.mean_distance_m is not None:
        sentence += f", {match.mean_distance_m:.2f} m from the true place on average"
    return f"{sentence}; {_count(len(match.false), 'false place') if match.false else 'no false place'}."


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"
