"""How often the true place lies in the 95 % error ellipse, over many simulated missions without pictures.

Each mission: people of several postures on rolling ground, one or two drones that pass over them, a detector
that reports the box of each body with noise, and telemetry with errors drawn from the mission's own
``fusion.uncertainty``. Everything from boxes to places is the real code.
Run: python -m tests.benchmarks.bench_error_ellipse [--missions 300]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.config.fusion import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.salient import salient_locations
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections, FloatArray
from pipeline.simulation.pose_noise import gauss_markov

CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
HEIGHT_M, SPEED_MPS, RATE_HZ = 15.0, 3.0, 5.0
#: width, depth, height: standing, sitting, lying
BODIES = ((0.5, 0.4, 1.75), (0.6, 0.8, 0.95), (0.5, 1.75, 0.3))
#: what a mission knows of itself
BUDGETS = {
    "plain satellite positioning (the defaults)": {},
    "RTK, good gimbal": {
        "position_bias": {"meters": 0.03},
        "height_bias": {"meters": 0.05},
        "attitude_bias": {"degrees": 0.3},
        "position_noise": {"meters": 0.02},
        "attitude_noise": {"degrees": 0.1},
        "terrain": {"meters": 0.1},
    },
    "unsteady: noise above bias": {
        "position_bias": {"meters": 0.2},
        "height_bias": {"meters": 0.2},
        "attitude_bias": {"degrees": 0.2},
        "position_noise": {"meters": 0.4},
        "attitude_noise": {"degrees": 0.8},
        "box": {"pixels": 4},
    },
}


@dataclass(frozen=True)
class Coverage:
    """places: found ones. inside: of these in their ellipse. error_m, semi_major_m: means."""

    places: int
    inside: int
    error_m: float
    semi_major_m: float

    @property
    def share(self) -> float:
        """0..1."""
        return self.inside / self.places


def params(budget: dict[str, object]) -> Fusion:
    """The demo's fusion with an error budget."""
    low, high = {"meters": 0.2}, {"meters": 2.2}
    return Fusion.model_validate(
        {
            "cell_size": {"meters": 0.5},
            "positive_max": 0.36,
            "negative_max": 0.2,
            "tukey_alpha": 0.5,
            "significant_point": "bottom_center",
            "object_size": {"width_min": low, "width_max": high, "height_min": low, "height_max": high},
            "threshold": 0.7,
            "cluster_distance": {"meters": 2.0},
            "lateness": {"seconds": 2.0},
            "uncertainty": budget,
        }
    )


def coverage(
    fusion: Fusion, missions: int, seed: int, actual: Fusion | None = None, focal_sd: float = 0.0
) -> Coverage:
    """actual: the errors drawn, if they are not those that the mission believes in.

    focal_sd: each stream's true focal length is drawn with it about the one that the mission has.
    """
    inside, errors, major = [], [], []
    for number in range(missions):
        rng = np.random.default_rng([seed, number])
        for found, truth in _mission(rng, fusion, actual or fusion, focal_sd):
            offset = truth[:2] - found.position_enu[:2]
            inside.append(found.error.contains(offset))
            errors.append(math.hypot(*offset))
            major.append(found.error.semi_major_m)
    return Coverage(len(inside), sum(inside), float(np.mean(errors)), float(np.mean(major)))


def _mission(rng, fusion, actual, focal_sd):  # type: ignore[no-untyped-def]
    """Found places with the person nearest to each."""
    terrain = _terrain(rng)
    people = _people(rng, terrain, actual.uncertainty.body)
    streams = ("a", "b")[: int(rng.integers(1, 3))]
    believed = replace(CAMERA, focal_sd=focal_sd)
    fuser = Fuser(_surveyed(rng, terrain, actual), fusion, dict.fromkeys(streams, believed), {"d": 1.0})
    true = {name: CAMERA.zoomed(1.0 + focal_sd * rng.normal() if focal_sd else 1.0) for name in streams}
    results = [r for name in streams for r in _flight(rng, name, people, terrain, actual, true[name])]
    for result in sorted(results, key=lambda r: r.order):
        fuser.apply(result)
    truth = np.array([center for center, _ in people])
    for found in salient_locations(fuser.map, fuser.looks, fusion):
        yield found, truth[np.argmin(np.hypot(*(truth[:, :2] - found.position_enu[:2]).T))]


def _terrain(rng: np.random.Generator) -> Terrain:
    axis = np.arange(-60.0, 60.0, 0.5) + 0.25
    east, north = np.meshgrid(axis, axis)
    k = rng.normal(size=4) * 0.04
    heights = 1.5 * np.sin(k[0] * east + k[1] * north) + 1.0 * np.sin(k[2] * east + k[3] * north + 1.0)
    return Terrain(LocalFrame(47.0, 8.0), -60.0, -60.0, 0.5, heights.astype(np.float32))


def _surveyed(rng: np.random.Generator, terrain: Terrain, actual: Fusion) -> Terrain:
    """The terrain as its model tells it: wrong by patches of 12 m and more."""
    x = (np.arange(terrain.shape[0]) + 0.5) * 0.5
    east, north = np.meshgrid(x, x)
    waves = [(rng.normal(size=2) * 0.2, rng.uniform(0, 2 * np.pi)) for _ in range(8)]
    error = sum(np.sin(k[0] * east + k[1] * north + phase) for k, phase in waves) / 2.0
    heights = terrain.heights_m + actual.uncertainty.terrain * error
    return Terrain(terrain.frame, terrain.east_m, terrain.north_m, 0.5, heights.astype(np.float32))


def _people(rng: np.random.Generator, terrain: Terrain, off_m: float) -> list[tuple[FloatArray, FloatArray]]:
    """Place on the ground (3,) and surface (N, 3) of each body, which is not quite there; 12 m apart."""
    people = []
    for east in (-12.0, 0.0, 12.0):
        for north in (-8.0, 6.0):
            spot = np.array([east, north]) + rng.uniform(-1.5, 1.5, 2)
            center = np.array([*spot, terrain.height(*spot)])
            people.append((center, center + np.array([*rng.normal(0.0, off_m, 2), 0.0]) + _body(rng)))
    return people


def _body(rng: np.random.Generator) -> FloatArray:
    angle, level = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 16), np.linspace(-1.0, 1.0, 9))
    ring = np.sqrt(1.0 - level**2)
    size = np.array(BODIES[int(rng.integers(len(BODIES)))]) * rng.uniform(0.85, 1.1)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), level], axis=-1).reshape(-1, 3)
    points = points * size / 2.0 + np.array([0.0, 0.0, size[2] / 2.0])
    heading = rng.uniform(0.0, 2.0 * np.pi)
    sine, cosine = math.sin(heading), math.cos(heading)
    return np.asarray(points @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]))


def _flight(rng, stream, people, terrain, actual, camera):  # type: ignore[no-untyped-def]
    """Two lanes, there and back, across the people in some direction. camera: the true one."""
    u, course = actual.uncertainty, rng.uniform(0.0, 2.0 * np.pi)
    along = np.array([math.sin(course), math.cos(course)])
    across = np.array([along[1], -along[0]])
    way = np.arange(-34.0, 24.0, SPEED_MPS / RATE_HZ)
    bias = rng.normal(size=6) * np.array([u.position_bias] * 2 + [u.height_bias] + [u.attitude_bias] * 3)
    times = np.arange(2 * len(way)) / RATE_HZ
    wander = gauss_markov(rng, times, u.correlation_time, 6)
    error = bias + wander * np.array([u.position_noise] * 3 + [u.attitude_noise] * 3)
    for i, time_s in enumerate(times):
        back = i >= len(way)
        turn = -1.0 if back else 1.0
        spot = turn * way[i % len(way)] * along + (6.0 if back else -6.0) * across
        true = np.array([*spot, terrain.height(*spot) + HEIGHT_M])
        angles = np.array([course + (math.pi if back else 0.0), math.radians(-45.0), 0.0])
        boxes = _boxes(rng, people, CameraPose(true, enu_from_camera(*angles)), u.box, camera)
        if not len(boxes):
            continue  # nothing that a place could rest on
        told = CameraPose(true + error[i, :3], enu_from_camera(*(angles + error[i, 3:])))
        scores, kinds = np.full(len(boxes), 0.85), np.zeros(len(boxes), dtype=np.int64)
        yield Detections(stream, "d", i, round(time_s * 1e9), told, boxes, scores, kinds)


def _boxes(rng, people, pose, std_px, camera):  # type: ignore[no-untyped-def]
    """Of the people who are whole in the picture, nine of ten."""
    boxes = []
    middles = camera.project_enu(np.array([center for center, _ in people]), pose)
    near = (middles > 0.0).all(axis=1) & (middles < (CAMERA.width, CAMERA.height)).all(axis=1)
    for surface in (people[k][1] for k in np.flatnonzero(near)):
        pixels = camera.project_enu(surface, pose)
        box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        whole = (box > 0).all() and box[2] < CAMERA.width and box[3] < CAMERA.height
        if whole and rng.random() < 0.9:
            # the box as a whole is off by std_px, and its size by a tenth
            size = rng.normal(1.0, 0.1, 2)
            middle, half = (box[:2] + box[2:]) / 2.0 + rng.normal(0.0, std_px, 2), (box[2:] - box[:2]) / 2.0
            boxes.append(np.concatenate([middle - size * half, middle + size * half]))
    return np.array(boxes).reshape(-1, 4)


def main() -> None:
    """Print the coverage of each budget."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=300)
    missions = parser.parse_args().missions
    wild = params(BUDGETS["RTK, good gimbal"] | {"box": {"pixels": 6}, "position_noise": {"meters": 0.15}})
    for name, budget in BUDGETS.items():
        _show(name, coverage(params(budget), missions, 1))
    rtk = params(BUDGETS["RTK, good gimbal"])
    for sd in (0.02, 0.1):
        _show(f"RTK, good gimbal, focal length good to {sd:.0%}", coverage(rtk, missions, 3, None, sd))
    _show("believes in RTK, noise is 3 to 7 times larger", coverage(rtk, missions, 2, wild))


def _show(name: str, c: Coverage) -> None:
    print(
        f"{name:50s} {c.inside:5d} of {c.places:5d} places inside: {c.share:.3f}; "
        f"mean error {c.error_m:.2f} m, mean semi-major axis {c.semi_major_m:.2f} m"
    )


if __name__ == "__main__":
    main()
