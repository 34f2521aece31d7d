"""Are the probabilities of the map right? Missions without pictures: people, cover, clutter, poses, a detector.

Each mission flies one or two drones over 80 m x 60 m in lanes, 25 m up, cameras 60 degrees down, 5 pictures a second.
Poses have a bias and noise, and the mission states both truly (``--understated 2``: half as large). Things that may be
taken for people lie about: each has a look of its own, the mean m of its scores, and is a person with probability m; so
scores are calibrated, over many things and not over many frames of one. A person is hidden from all frames of a second
at once with a probability of his own (cover), else found with the detector's recall; what is no person is taken for one
in a share of frames of its own. And single boxes appear anywhere.

What is judged, on seeds apart from those that anything was fitted to:
- the probabilities of found and possible places against whether somebody is within 2 m or within the ellipse, as the
  expected calibration error over ten bins of equal count;
- the probability of detection (POD) of the cells where people lie, for each drone's flight alone, against whether
  that flight detected them, in the same way, by cover;
- how often the 95 % ellipse of a found place holds its person;
- in how many missions two drones are named that do not agree.

Run: python -m tests.benchmarks.bench_map_truth [--missions 100] [--seed 5001] [--understated 2]
"""

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from pipeline.config.fusion import Fusion
from pipeline.fusion.disagreement import disagreements
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.possible import found_and_possible
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections
from pipeline.sensor.substream import SubstreamModel

CAMERA = Camera(1024, 576, 800.0, 800.0, 512.0, 288.0)
UP_M, PITCH, RATE_HZ, SPEED = 25.0, math.radians(-60.0), 5.0, 5.0
HALF_EAST, HALF_NORTH, LANES = 40.0, 30.0, 4
PERSON_M = (0.6, 1.2)
MATCH_M = 2.0
#: judged on these missions; what was tried out was tried on seeds from 1001
SEED = 5001


@dataclass(frozen=True)
class Thing:
    """at: east, north. score: the mean of its scores. shown: share of frames; cover: share of seconds hidden."""

    at: np.ndarray
    score: float
    person: bool
    shown: float
    cover: float


@dataclass(frozen=True)
class World:
    """noise_m, bias_m: of positions. recall: of the detector, for people who are not hidden."""

    things: tuple[Thing, ...]
    noise_m: float
    bias_m: float
    recall: float
    drones: int


def draw(rng) -> World:
    things = []
    recall = rng.uniform(0.4, 0.95)
    for _ in range(rng.poisson(8)):
        score = rng.uniform(0.3, 0.95)
        person = rng.random() < score
        shown = recall if person else rng.uniform(0.1, 0.9)
        cover = rng.uniform(0.0, 0.8) if person else 0.0
        at = rng.uniform(-1.0, 1.0, 2) * (HALF_EAST - 4.0, HALF_NORTH - 4.0)
        things.append(Thing(at, score, person, shown, cover))
    noise, bias = float(rng.choice([0.02, 0.3, 1.0])), float(rng.choice([0.02, 1.3]))
    return World(tuple(things), noise, bias, recall, int(rng.integers(1, 3)))


def fusion(world: World, understated: float) -> Fusion:
    metres = {"position_bias": world.bias_m, "height_bias": world.bias_m, "position_noise": world.noise_m}
    degrees = {"attitude_bias": 0.5, "attitude_noise": 0.1}
    low, high = {"meters": 0.4}, {"meters": 2.2}
    return Fusion.model_validate(
        {
            "cell_size": {"meters": 0.5},
            "object_size": {"width_min": low, "width_max": high, "height_min": low, "height_max": high},
            "uncertainty": {k: {"meters": v / understated} for k, v in metres.items()}
            | {k: {"degrees": v / understated} for k, v in degrees.items()},
        }
    )


def flight(rng, world: World, drone: int, up_m: float = UP_M):
    """Times, true and told poses of one drone: lanes to and fro, the drones' lanes between each other."""
    per_lane = round(2.0 * HALF_NORTH / SPEED * RATE_HZ)
    bias, turn = rng.normal(size=3) * world.bias_m, rng.normal(size=3) * math.radians(0.5)
    wander = rng.normal(size=6)
    kept = math.exp(-1.0 / RATE_HZ / 2.0)
    for k in range(LANES * per_lane):
        lane, along = divmod(k, per_lane)
        north = -HALF_NORTH + along * SPEED / RATE_HZ
        yaw = 0.0 if lane % 2 == 0 else math.pi
        east = -HALF_EAST + (lane + 0.5 + 0.25 * drone) * 2.0 * HALF_EAST / LANES
        at = np.array([east, north if lane % 2 == 0 else -north, up_m])
        wander = kept * wander + rng.normal(size=6) * math.sqrt(1.0 - kept * kept)
        angles = np.array([yaw, PITCH, 0.0])
        told = CameraPose(
            at + bias + wander[:3] * world.noise_m,
            enu_from_camera(*(angles + turn + wander[3:] * math.radians(0.1))),
        )
        yield k, CameraPose(at, enu_from_camera(*angles)), told


def boxes_of(rng, world: World, hidden, k: int, pose: CameraPose):
    """Boxes and scores of one picture."""
    boxes, scores = [], []
    block = int(k / RATE_HZ)
    for thing, its in zip(world.things, hidden, strict=True):
        box = _box(thing.at, pose)
        if box is not None and not its[block] and rng.random() < thing.shown:
            boxes.append(box)
            z = math.log(thing.score / (1.0 - thing.score)) + rng.normal() * 0.4
            scores.append(1.0 / (1.0 + math.exp(-z)))
    if rng.random() < 0.02:
        box = _box(
            pose.position_enu[:2] + rng.uniform(-8.0, 8.0, 2) + (0.0, 14.0 * pose.enu_from_camera[1, 2] * 2),
            pose,
        )
        if box is not None:
            boxes.append(box)
            scores.append(rng.uniform(0.3, 0.6))
    return np.array(boxes).reshape(-1, 4), np.array(scores)


def _box(at, pose: CameraPose):
    foot = CAMERA.project_enu(np.array([[at[0], at[1], 0.0]]), pose)[0]
    distance = math.dist((at[0], at[1], 0.0), pose.position_enu)
    w, h = (side * CAMERA.fx / distance for side in PERSON_M)
    box = [foot[0] - w / 2.0, foot[1] - h, foot[0] + w / 2.0, foot[1]]
    ahead = (np.array([at[0], at[1], 0.0]) - pose.position_enu) @ pose.enu_from_camera[:, 2] > 0.0
    return box if ahead and box[0] > 3 and box[1] > 3 and box[2] < 1021 and box[3] < 573 else None


def mission(case):
    """One mission: places (probability, right, listed), ellipses (held), whether two streams that do not agree were
    named (None: one stream), passes (POD, found, cover)."""
    seed, understated = case
    rng = np.random.default_rng(seed)
    world = draw(rng)
    params = fusion(world, understated)
    cells = round(120.0 / 0.5)
    terrain = Terrain(LocalFrame(48.0, 15.0), -60.0, -60.0, 0.5, np.zeros((cells, cells), np.float32))
    streams = [f"s{i}" for i in range(world.drones)]
    # what an evaluation on people like these would have measured: mean cover 0.4, with this recall
    found = SubstreamModel(1.0, 1.0, (4.0, 12.0), (0.0, 0.6 * world.recall), CAMERA.width)
    substreams = {(s, "d"): found for s in streams}
    cameras = dict.fromkeys(streams, CAMERA)
    whole = Fuser(terrain, params, cameras, {"d": 1.0}, substreams=substreams)
    results, passes = [], []
    for i, stream in enumerate(streams):
        alone = Fuser(terrain, params, cameras, {"d": 1.0}, substreams=substreams)
        seconds = int(LANES * 2.0 * HALF_NORTH / SPEED) + 2
        hidden = [rng.random(seconds) < thing.cover for thing in world.things]
        for k, true, told in flight(rng, world, i):
            boxes, scores = boxes_of(rng, world, hidden, k, true)
            ids = np.zeros(len(boxes), np.int64)
            result = Detections(stream, "d", k, int(k / RATE_HZ * 1e9) + i, told, boxes, scores, ids)
            results.append(result)
            alone.apply(result)
        passes += _passes(alone, world, params)
    for result in sorted(results, key=lambda r: r.order):
        whole.apply(result)
    return *_judged(whole, world, params), passes


def _judged(fuser, world, params):
    places, held = [], []
    people = np.array([t.at for t in world.things if t.person]).reshape(-1, 2)
    listed, possible = found_and_possible(fuser.maps, fuser.looks, params)
    warned = bool(disagreements(listed, params.uncertainty)) if world.drones > 1 else None
    for place in (*listed, *possible):
        offsets = people - place.position_enu[:2]
        distance = np.hypot(*offsets.T) if len(people) else np.array([math.inf])
        right = bool(distance.min() < MATCH_M) or any(place.error.contains(o) for o in offsets)
        places.append((place.probability, right, place in listed))
        others = [np.hypot(*(t.at - place.position_enu[:2])) for t in world.things if not t.person]
        if place in listed and distance.min() < min([6.0, *others]):
            held.append(place.error.contains(offsets[int(distance.argmin())]))
    return places, held, warned


def _passes(fuser, world, params):
    near = [look.intersection_enu[:2] for look in fuser.looks]
    found = np.array(near).reshape(-1, 2)
    rows = []
    for thing in world.things:
        row, column = fuser.map.terrain.cell(*thing.at)
        if thing.person and fuser.map.looks[row, column]:
            hit = len(found) and bool((np.hypot(*(found - thing.at).T) < 3.0 + 2.0 * world.bias_m).any())
            rows.append((float(fuser.map.pod[row, column]), hit, thing.cover))
    return rows


def calibration_error(probabilities, right, bins=10):
    """Over bins of equal count; and the bins: mean probability, share right."""
    order = np.argsort(probabilities, kind="stable")
    parts = np.array_split(order, bins)
    rows = [(probabilities[p].mean(), right[p].mean(), len(p)) for p in parts if len(p)]
    return sum(abs(a - b) * n for a, b, n in rows) / len(order), rows


def main() -> None:
    """Measure and print."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--missions", type=int, default=100)
    arguments.add_argument("--seed", type=int, default=SEED)
    arguments.add_argument("--understated", type=float, default=1.0)
    given = arguments.parse_args()
    with ProcessPoolExecutor(2) as pool:
        done = list(pool.map(mission, [(given.seed + k, given.understated) for k in range(given.missions)]))
    places = [p for part, *_ in done for p in part]
    p, right = (np.array([place[i] for place in places], dtype=float) for i in (0, 1))
    error, rows = calibration_error(p, right)
    print(
        f"{len(places)} places, {int(sum(x[2] for x in places))} listed; expected calibration error {error:.3f}"
    )
    for a, b, n in rows:
        print(f"  said {a:.2f}  was {b:.2f}  ({n})")
    passes = np.array([q for *_, part in done for q in part], dtype=float)
    error, rows = calibration_error(passes[:, 0], passes[:, 1])
    print(f"{len(passes)} passes over people: expected calibration error of POD {error:.3f}")
    for a, b, n in rows:
        print(f"  said {a:.2f}  was {b:.2f}  ({n})")
    held = [h for _, part, *_ in done for h in part]
    warned = [w for _, _, w, _ in done if w is not None]
    print(f"warned of two streams that do not agree: {sum(warned)} of {len(warned)} missions with two")
    print(f"95 % ellipse holds the person: {np.mean(held):.3f} of {len(held)}")


if __name__ == "__main__":
    main()
