"""On a plane with texture, filmed along any way: right telemetry is believed, and each fault gets its name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.ingest.checks.motion_check import Other, check_motion
from pipeline.ingest.checks.picture_motion import Motion, picture_motion
from pipeline.ingest.checks.predicted_motion import Predictor, angles_of
from pipeline.ingest.finding import Finding
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import FloatArray

CAMERA = Camera(384, 216, 340.0, 340.0, 192.0, 108.0)
TERRAIN = Terrain(LocalFrame(47.0, 8.0), -200.0, -200.0, 2.0, np.zeros((200, 200), np.float32))
RATE_HZ, SECONDS = 8, 14
TIMES_S = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)


def trajectory(position: FloatArray, angles_deg: FloatArray) -> Trajectory:
    n = len(TIMES_S)
    angles = np.radians(angles_deg)
    angles[:, 0] = np.unwrap(angles[:, 0])
    return Trajectory(
        TIMES_S, position, angles, np.full((n, 3), np.nan), np.ones(n), float(SECONDS), 3.0, 0, "utc"
    )


def way(
    east: FloatArray, north: FloatArray, yaw_deg: FloatArray, up: float = 25.0, pitch: float = -50.0
) -> Trajectory:
    one = np.ones(len(TIMES_S))
    position = np.stack([east * one, north * one, up * one], axis=1)
    return trajectory(position, np.stack([yaw_deg * one, pitch * one, 0.0 * one], axis=1))


def lanes() -> Trajectory:
    north = np.where(TIMES_S < 7.0, 3.0 * TIMES_S, 21.0 - 3.0 * (TIMES_S - 7.0)) + 0.4 * np.sin(2.0 * TIMES_S)
    return way(0.3 * TIMES_S, north, np.where(TIMES_S < 7.0, 10.0, 190.0))


def orbit() -> Trajectory:
    turn = 0.15 * TIMES_S + 0.2 * np.sin(0.9 * TIMES_S)
    return way(15.0 * np.cos(turn), 15.0 * np.sin(turn), np.degrees(-np.pi / 2 - turn), up=20.0)


FLIGHTS: dict[str, Callable[[], Trajectory]] = {"lanes": lanes, "orbit": orbit}


@cache
def ground_texture() -> FloatArray:
    rng = np.random.default_rng(5)
    layers = [gaussian_filter(rng.normal(size=(512, 512)), s, mode="wrap") * s for s in (1.0, 2.5, 6.0)]
    return np.asarray(127.0 + 45.0 * sum(layers) / np.std(sum(layers)))


def film(path: Path, flown: Trajectory, camera: Camera = CAMERA) -> None:
    """What the camera sees of a plane with texture at height 0."""
    texture = ground_texture()
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = camera.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(RATE_HZ), options={"g": "8", "crf": "20"})
        stream.width, stream.height, stream.pix_fmt = camera.width, camera.height, "yuv420p"
        for time_s in TIMES_S.tolist():
            picture = av.VideoFrame.from_ndarray(seen(flown, time_s, rays, texture, camera), format="gray")
            container.mux(stream.encode(picture.reformat(format="yuv420p")))
        container.mux(stream.encode())


def seen(
    flown: Trajectory, time_s: float, rays: FloatArray, texture: FloatArray, camera: Camera
) -> NDArray[np.uint8]:
    pose = flown.pose(time_s)
    assert pose is not None
    directions = rays @ pose.enu_from_camera.T
    reach = -pose.position_enu[2] / np.minimum(directions[:, 2], -1e-3)
    points = pose.position_enu[:2] + reach[:, None] * directions[:, :2]
    values = map_coordinates(texture, (points / 0.15).T[::-1], order=1, mode="grid-wrap")
    return np.clip(values, 0, 255).astype(np.uint8).reshape(camera.height, camera.width)


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Motion]:
    folder = tmp_path_factory.mktemp("motion")
    result = {}
    for name, make in FLIGHTS.items():
        film(folder / f"{name}.mp4", make())
        result[name] = picture_motion(folder / f"{name}.mp4", float(SECONDS))
    return result


def found(
    motion: Motion,
    told: Trajectory,
    camera: Camera = CAMERA,
    others: dict[str, tuple[Trajectory, Motion]] | None = None,
) -> list[Finding]:
    known = {
        name: Other(Predictor(motion, t, camera, TERRAIN), Predictor(there, told, camera, TERRAIN))
        for name, (t, there) in (others or {}).items()
    }
    return check_motion("drone.srt", Predictor(motion, told, camera, TERRAIN), known)


def turned(flown: Trajectory, yaw_deg: float = 0.0, pitch_sign: float = 1.0) -> Trajectory:
    angles = flown.angles_rad * (1.0, pitch_sign, 1.0) + (math.radians(yaw_deg), 0.0, 0.0)
    return replace(flown, angles_rad=angles)


def lifted(flown: Trajectory, up_m: float) -> Trajectory:
    return replace(flown, positions_enu=flown.positions_enu + np.array([0.0, 0.0, up_m]))


def later(flown: Trajectory, seconds: float) -> Trajectory:
    return replace(flown, times_s=flown.times_s + seconds, end_s=flown.end_s + seconds)


def still(flown: Trajectory) -> Trajectory:
    return replace(flown, positions_enu=np.tile(flown.positions_enu[:1], (len(TIMES_S), 1)))


@pytest.mark.parametrize("name", FLIGHTS)
def test_telemetry_that_is_right_gives_no_finding(motions: dict[str, Motion], name: str) -> None:
    assert found(motions[name], FLIGHTS[name]()) == []


@pytest.mark.parametrize(
    ("cause", "spoil"),
    [
        ("heading_off", lambda t: turned(t, 180.0)),
        ("heading_off", lambda t: turned(t, -90.0)),
        ("heading_off", lambda t: turned(t, 12.0)),
        ("pitch_sign", lambda t: turned(t, 0.0, -1.0)),
        ("height_off", lambda t: lifted(t, 30.0)),
        ("height_off", lambda t: lifted(t, -6.0)),
        ("clock_off", lambda t: later(t, 1.2)),
        ("clock_off", lambda t: later(t, -0.6)),
        ("frozen", still),
    ],
)
@pytest.mark.parametrize("name", FLIGHTS)
def test_each_fault_gets_its_name(
    motions: dict[str, Motion], name: str, cause: str, spoil: Callable[[Trajectory], Trajectory]
) -> None:
    (finding,) = found(motions[name], spoil(FLIGHTS[name]()))
    assert finding.severity == "warning"
    assert cause in finding.cause.split("/")
    assert finding.mend


def test_a_wrong_focal_length_is_that_or_a_height(motions: dict[str, Motion]) -> None:
    # an orbit about what it looks at hides it: the turn of the camera and its way cancel in the picture's middle
    wrong = replace(CAMERA, fx=0.85 * CAMERA.fx, fy=0.85 * CAMERA.fy)
    (finding,) = found(motions["lanes"], lanes(), wrong)
    assert "focal_length" in finding.cause.split("/")


def test_exchanged_telemetry_is_recognised_by_the_other_video_and_a_foreign_one_by_none(
    motions: dict[str, Motion],
) -> None:
    (finding,) = found(motions["lanes"], orbit(), others={"orbit": (lanes(), motions["orbit"])})
    assert finding.cause == "exchanged"
    # the other video is not that of this telemetry: then nothing was exchanged with it
    (finding,) = found(motions["lanes"], lifted(lanes(), 15.0), others={"other": (lanes(), motions["lanes"])})
    assert "exchanged" not in finding.cause
    (finding,) = found(motions["lanes"], orbit())
    assert finding.cause == "other_flight"


def test_the_mend_of_a_heading_is_the_turn_that_is_missing(motions: dict[str, Motion]) -> None:
    (finding,) = found(motions["orbit"], turned(orbit(), 40.0))
    assert "telemetry.yaw_offset: {degrees: -40}" in finding.mend or "{degrees: -39}" in finding.mend


def test_pictures_without_motion_or_texture_are_said_to_show_nothing(tmp_path: Path) -> None:
    hover = way(np.zeros(1), np.zeros(1), np.zeros(1))
    film(tmp_path / "hover.mp4", hover)
    (finding,) = found(picture_motion(tmp_path / "hover.mp4", float(SECONDS)), hover)
    assert (finding.severity, finding.cause) == ("assumed", "motion_unseen")
    (tmp_path / "no.mp4").write_bytes(b"no video")
    assert len(picture_motion(tmp_path / "no.mp4", 5.0).first_s) == 0


@pytest.mark.parametrize(
    "angles", [(0.3, -0.7, 0.1), (-2.9, -1.2, 0.0), (1.0, 0.4, -0.5), (0.7, -math.pi / 2, 0.0)]
)
def test_angles_of_a_rotation_are_those_that_made_it(angles: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(
        enu_from_camera(*angles_of(enu_from_camera(*angles))), enu_from_camera(*angles), atol=1e-6
    )
