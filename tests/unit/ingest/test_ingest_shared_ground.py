"""Two drones that fly alike over one ground: with each other's telemetry, what both saw does not lie in one place."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.ingest.checks.picture_motion import Motion
from pipeline.ingest.checks.shared_ground import Filmed, check_shared_ground
from pipeline.ingest.trajectory import Trajectory

CAMERA = Camera(320, 180, 240.0, 240.0, 160.0, 90.0)
TERRAIN = Terrain(LocalFrame(47.0, 8.0), -200.0, -200.0, 2.0, np.full((200, 200), 5.0, np.float32))
TIMES_S = np.arange(0.0, 12.0, 0.5)
TEXEL_M = 0.2


def ground(seed: int) -> NDArray[np.float64]:
    noise = np.random.default_rng(seed).normal(size=(1000, 1000))
    texture = gaussian_filter(noise, 1.5) + 2.0 * gaussian_filter(noise[::-1], 6.0)
    return np.asarray(128.0 + 40.0 * texture / texture.std())


def lane(east_m: float, yaw_deg: float = 0.0, off_m: float = 0.0, up_m: float = 30.0) -> Trajectory:
    """Northward at 3 m/s, the camera 60 degrees down; off_m: an error that stays."""
    n = len(TIMES_S)
    position = np.column_stack([np.full(n, east_m + off_m), 3.0 * TIMES_S - 15.0 + off_m, np.full(n, up_m)])
    angles = np.tile(np.radians([yaw_deg, -60.0, 0.0]), (n, 1))
    return Trajectory(TIMES_S, position, angles, np.full((n, 3), np.nan), np.ones(n), 12.0, 3.0, 0, "utc")


def sights(true: Trajectory, texture: NDArray[np.float64]) -> tuple[tuple[float, NDArray[np.uint8]], ...]:
    columns, rows = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    shown = []
    for time_s in TIMES_S[:-1].tolist():
        pose = true.pose(time_s)
        assert pose is not None
        rays = CAMERA.rays_enu(pixels, pose)
        places = pose.position_enu + rays * ((5.0 - pose.position_enu[2]) / rays[:, 2])[:, None]
        texels = [(places[:, 1] + 100.0) / TEXEL_M, (places[:, 0] + 100.0) / TEXEL_M]
        values = map_coordinates(texture, texels, order=1, mode="wrap")
        shown.append((time_s, np.clip(values, 0, 255).astype(np.uint8).reshape(CAMERA.height, CAMERA.width)))
    return tuple(shown)


def filmed(name: str, true: Trajectory, told: Trajectory, texture: NDArray[np.float64]) -> Filmed:
    none = np.zeros((0, 2))
    motion = Motion(
        np.zeros(0), np.zeros(0), none, none, np.zeros(0, np.int64), 1.0, 0, sights(true, texture)
    )
    return Filmed(f"{name}.srt", motion, told, CAMERA)


def found(
    one: tuple[Trajectory, Trajectory], other: tuple[Trajectory, Trajectory], seeds: tuple[int, int]
) -> list[str]:
    """one, other: the true way and the one that its telemetry tells. Findings; without, how many pairs agree."""
    streams = {n: filmed(n, *ways, ground(s)) for n, ways, s in zip("ab", (one, other), seeds, strict=True)}
    shared = check_shared_ground(streams, TERRAIN)
    assert shared.exchanged == (frozenset("ab") if shared.findings else frozenset())
    return [f"{f.cause} {f.where}" for f in shared.findings] or [str(len(shared.apart))]


WAYS = {
    "lane beside lane": (lane(-6.0), lane(6.0)),
    "lanes that look towards each other": (lane(-12.0, 30.0), lane(12.0, -30.0)),
    "lanes at two heights": (lane(-6.0, up_m=25.0), lane(6.0, up_m=40.0)),
}


@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("off_m", [0.0, 1.5])
def test_exchanged_telemetry_of_drones_that_fly_alike_is_seen_on_the_ground(name: str, off_m: float) -> None:
    one, other = WAYS[name]
    told = [lane(float(w.positions_enu[0, 0]), float(np.degrees(w.angles_rad[0, 0])), o, float(w.positions_enu[0, 2]))
            for w, o in ((one, off_m), (other, -off_m / 2))]  # fmt: skip
    assert found((one, told[0]), (other, told[1]), (1, 1)) == ["1"]
    assert found((one, told[1]), (other, told[0]), (1, 1)) == ["exchanged a.srt", "exchanged b.srt"]


def test_drones_over_different_ground_are_not_called_exchanged() -> None:
    one, other = WAYS["lane beside lane"]
    assert found((one, other), (other, one), (1, 2)) == ["0"]
    far = lane(90.0)
    assert found((one, one), (far, far), (1, 1)) == ["0"]


def test_two_cameras_of_one_drone_are_not_exchanged() -> None:
    one = lane(0.0)
    assert found((one, lane(0.3)), (lane(0.3), one), (1, 2)) == ["0"]
    assert found((one, lane(0.3)), (lane(0.3), one), (1, 1)) == ["0"]


def test_ground_without_texture_tells_nothing() -> None:
    one, other = WAYS["lane beside lane"]
    flat = np.full((1000, 1000), 90.0)
    streams = {"a": filmed("a", one, other, flat), "b": filmed("b", other, one, flat)}
    assert check_shared_ground(streams, TERRAIN).findings == ()
