"""Fusing the same detections again, with other parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.config.fusion import Fusion
from pipeline.errors import InputError
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.salient import SalientLocation, salient_locations
from pipeline.messages import Detections
from pipeline.mission.prepared import PreparedMission, prepare, terrain_at
from pipeline.outputs.truth import TruePerson, TruthMatch, load_truth, match_truth

#: with this many metres a place still belongs to a person: half of how far apart the people of the
#: experiments' missions are, so that a large error is counted as an error and not as a missed person
MATCH_RADIUS_M = 3.0


@dataclass(frozen=True, eq=False)
class Fused:
    """A map made again, the places in it, and how they compare with the truth."""

    fuser: Fuser
    fusion: Fusion
    locations: tuple[SalientLocation, ...]
    truth: tuple[TruePerson, ...]
    match: TruthMatch

    @property
    def mean_error_m(self) -> float:
        """Of the found people; NaN if nobody was found."""
        return float("nan") if self.match.mean_distance_m is None else self.match.mean_distance_m


def fuse_again(
    prepared: PreparedMission,
    results: Sequence[Detections],
    fusion: Fusion,
    relative_accuracy: Mapping[str, float] | None = None,
    after: Callable[[int, Fuser], None] | None = None,
) -> Fused:
    """The map by the paper's update rule, whatever the mission's: the experiments are the paper's.

    results: in order. relative_accuracy: p_det_rel by pool detector, the pool's if absent.

    after: called with the number of each result and the fuser that has taken it.
    """
    fusion = fusion.model_copy(update={"update_rule": "paper"})
    same = fusion.cell_size == prepared.mission.fusion.cell_size
    terrain = prepared.terrain if same else terrain_at(prepared, fusion.cell_size)
    by_pool = relative_accuracy or prepared.relative_accuracy
    by_detector = {result.detector: by_pool[result.detector.rpartition(":")[2]] for result in results}
    fuser = Fuser(terrain, fusion, prepared.cameras, by_detector)
    for number, result in enumerate(results):
        fuser.apply(result)
        if after is not None:
            after(number, fuser)
    locations = salient_locations(fuser.map, fuser.looks, fusion)
    truth = load_truth(prepared.mission.truth, prepared.frame) if prepared.mission.truth else ()
    return Fused(fuser, fusion, locations, truth, match_truth(locations, truth, MATCH_RADIUS_M))


def prepare_with_truth(mission: Path) -> PreparedMission:
    """As ``prepare``; InputError if nobody knows where the people are."""
    prepared = prepare(mission)
    if prepared.mission.truth is None or not load_truth(prepared.mission.truth, prepared.frame):
        raise InputError(f"{mission} truth", "nobody", "a file with the people's true places")
    return prepared
