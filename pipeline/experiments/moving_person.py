"""Experiment 2: a person walks past a hovering drone; how long does the map remember where the person was?

The trail is made of the cells that a detection raised above one half. A cell is out of the map when its
probability is one half or less again. Its age is the time since a detection last raised it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.config.scenario import load_scenario
from pipeline.errors import InputError
from pipeline.experiments.detection_cache import Progress, detections_of
from pipeline.experiments.experiment_report import Experiment, Measure
from pipeline.experiments.refusion import fuse_again
from pipeline.fusion.fuser import Fuser
from pipeline.geo.terrain import Terrain
from pipeline.messages import Detections, FloatArray
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.outputs.truth import TruePerson, load_truth
from pipeline.simulation.mission_writer import write_rehearsal
from pipeline.simulation.models import MISSION_MODELS
from pipeline.simulation.person import Person
from pipeline.simulation.places import exposure
from pipeline.simulation.rehearsal import Rehearsal, rehearse
from pipeline.simulation.scene import clear_of

NEGATIVE_MAX = (0.05, 0.5)
_GONE = 0.5
_STRAIGHT_M = 1e6
_PICTURE_TIMES_S = (4.0, 8.0, 12.0)


@dataclass(frozen=True, eq=False)
class Trail:
    """What one run of the fusion remembers.

    times_s: float64 (T,), since the first result. age_s: float64 (T,), of the oldest cell of the trail, 0
    without one. alive, left: how many cells still stood after 5 s, of those that were left so long ago.
    lifetime_s: float64 (N,), from a cell's last raise to its end. maps: probability at _PICTURE_TIMES_S.
    """

    negative_max: float
    times_s: FloatArray
    age_s: FloatArray
    alive: int
    left: int
    lifetime_s: FloatArray
    maps: list[NDArray[np.float32]]


def moving_person(scenario: Path, out: Path, progress: Progress) -> Experiment:
    """scenario: of a drone that hovers. out: the rendered mission and the detections stay there."""
    mission = out / "mission" / "mission.yaml"
    if not mission.is_file():
        write_rehearsal(_with_walker(scenario), mission.parent, progress=progress)
    prepared = prepare(mission)
    results = detections_of(prepared, out / "detections.msgpack", progress)
    trails = [_trail(prepared, results, value) for value in NEGATIVE_MAX]
    truth = load_truth(prepared.mission.truth, prepared.frame) if prepared.mission.truth else ()
    pictures = {"maps": _maps_picture(prepared, trails, truth), "age": _age_picture(trails)}
    seen = sum(len(result.scores) > 0 for result in results)
    text = (
        f"A drone hovers 15 m above the ground, its camera 45 degrees down; a person walks left to right. "
        f"{seen} of {len(results)} frames, {_rate(results):.0f} a second, have a "
        "detection. A cell's age is the time since a detection last raised it; it is gone when its "
        "probability is one half or less."
    )
    return Experiment(2, "rate of negative update", text, _measures(*trails), pictures)


def _measures(slow: Trail, fast: Trail) -> list[Measure]:
    share = slow.alive / slow.left if slow.left else 0.0
    return [
        Measure(
            "oldest trail, p_negative_max 0.5", float(fast.age_s.max()), "s", "removed rapidly", "<=", 1.0
        ),
        Measure("oldest trail, p_negative_max 0.05", float(slow.age_s.max()), "s", "a trail", ">=", 5.0),
        Measure("share of the cells left 5 s ago that still stand, 0.05", share, "", "", ">=", 0.5),
        Measure("median lifetime of a cell, 0.05", float(np.median(slow.lifetime_s)), "s", ""),
        Measure("median lifetime of a cell, 0.5", float(np.median(fast.lifetime_s)), "s", ""),
    ]


def _with_walker(path: Path) -> Rehearsal:
    """The scenario with one person who crosses the picture where nothing is in the way."""
    scenario = load_scenario(path)
    empty = rehearse(scenario, ())
    speed_mps = scenario.people.walking_speed
    length_m = speed_mps * scenario.flight.longest
    best, best_share = None, 0.0
    for north in np.arange(-6.0, 6.1, 0.5):
        way = [(float(east), float(north)) for east in np.linspace(-length_m / 2.0, length_m / 2.0, 9)]
        if not all(clear_of(empty.scene.obstacles, *spot, 0.4) for spot in way):
            continue
        stands = [Person(0, MISSION_MODELS[1], *spot, math.pi / 2.0) for spot in way]
        share = float(np.mean([exposure(p, empty.scene, scenario.flight)[1] for p in stands]))
        if share > best_share:
            start = way[0]
            best = Person(0, MISSION_MODELS[1], *start, math.pi / 2.0, speed_mps, _STRAIGHT_M)
            best_share = share
    if best is None:
        raise InputError(f"{path} seed", "a place without a free straight way", "another seed")
    return rehearse(scenario, (best,))


def _trail(prepared: PreparedMission, results: list[Detections], negative_max: float) -> Trail:
    fusion = prepared.mission.fusion.model_copy(update={"negative_max": negative_max})
    raised: dict[tuple[int, int], float] = {}
    ended: dict[tuple[int, int], float] = {}
    times, ages, maps = [], [], {}
    start_ns = results[0].time_ns

    def watch(number: int, fuser: Fuser) -> None:
        now_s = (results[number].time_ns - start_ns) * 1e-9
        probability = fuser.map.probability()
        for look in (k for k in fuser.looks if k.time_ns == results[number].time_ns):
            raised[look.row, look.column] = now_s
            ended.pop((look.row, look.column), None)
        standing = [cell for cell in raised if probability[cell] > _GONE]
        for cell in raised:
            if probability[cell] <= _GONE:
                ended.setdefault(cell, now_s)
        times.append(now_s)
        ages.append(max((now_s - raised[cell] for cell in standing), default=0.0))
        for wanted in _PICTURE_TIMES_S:
            if now_s <= wanted + 1e-6:
                maps[wanted] = np.where(fuser.map.observations > 0, probability, np.nan)

    fuse_again(prepared, results, fusion, after=watch)
    last = times[-1]
    life = {cell: ended.get(cell, last) - raised[cell] for cell in raised}
    left = [cell for cell in raised if raised[cell] <= last - 5.0]
    alive = sum(life[cell] >= 5.0 for cell in left)
    return Trail(
        negative_max,
        np.array(times),
        np.array(ages),
        alive,
        len(left),
        np.array([life[cell] for cell in left]),
        [maps[wanted] for wanted in _PICTURE_TIMES_S],
    )


def _rate(results: list[Detections]) -> float:
    return 1e9 * (len(results) - 1) / (results[-1].time_ns - results[0].time_ns)


def _maps_picture(prepared: PreparedMission, trails: list[Trail], truth: tuple[TruePerson, ...]) -> Figure:
    """The picture of the drone at some times, and below it the map of each trail at the same times."""
    columns = len(_PICTURE_TIMES_S)
    figure = Figure(figsize=(11, 6.4), dpi=110, layout="constrained")
    axes = figure.subplots(1 + len(trails), columns, height_ratios=[1.6, 1.0, 1.0])
    _draw_frames(axes[0], prepared)
    track = truth[0].track_enu
    east, north = (track[:, 0].min() - 2.0, track[:, 0].max() + 2.0), float(track[:, 1].mean())
    for row, trail in zip(axes[1:], trails, strict=True):
        for one, time_s, probability in zip(row, _PICTURE_TIMES_S, trail.maps, strict=True):
            shown = one.imshow(
                probability, origin="lower", extent=_extent(prepared.terrain), vmin=0.0, vmax=1.0,
                interpolation="nearest",
            )  # fmt: skip
            now = track[min(round(2.0 * time_s), len(track) - 1)]  # the truth has a point every half second
            one.plot(*now, "x", color="#D55E00", ms=8, mew=2.2)
            one.set(xlim=east, ylim=(north - 1.8, north + 1.8))
            one.set_title(f"p_negative_max {trail.negative_max:g}, after {time_s:g} s", fontsize=9)
            one.tick_params(labelsize=8)
    figure.colorbar(shown, ax=axes[1:], shrink=0.9, label="probability of a person")
    figure.supxlabel("east, m (upwards: north); x: where the person is now", fontsize=9)
    return figure


def _draw_frames(row: Sequence[Axes], prepared: PreparedMission) -> None:
    stream = prepared.streams[0]
    shown_s = stream.source.times_s
    times_s = {float(shown_s[np.abs(shown_s - t).argmin()]): t for t in _PICTURE_TIMES_S}
    for one, (time_s, image) in zip(row, stream.source.images_at(times_s), strict=True):
        one.imshow(image)
        one.set_title(f"what the drone sees after {times_s[time_s]:g} s", fontsize=9)
        one.set_axis_off()


def _extent(terrain: Terrain) -> tuple[float, float, float, float]:
    rows, columns = terrain.shape
    east, north, cell = terrain.east_m, terrain.north_m, terrain.cell_m
    return east, east + columns * cell, north, north + rows * cell


def _age_picture(trails: list[Trail]) -> Figure:
    figure = Figure(figsize=(7, 3.2), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    for trail, color in zip(trails, ("#0072B2", "#D55E00"), strict=True):
        axes.plot(trail.times_s, trail.age_s, color=color, label=f"p_negative_max {trail.negative_max:g}")
    for limit in (1.0, 5.0):
        axes.axhline(limit, color="#888888", lw=0.8, ls=":")
    axes.set(xlabel="time, s", ylabel="age of the oldest cell of the trail, s")
    axes.legend(frameon=False)
    return figure
