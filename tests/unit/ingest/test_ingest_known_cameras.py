"""A camera is known by its exact name, with its source and its uncertainty, or it is asked for."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from pipeline.config.camera import CameraSource
from pipeline.errors import InputError
from pipeline.ingest.cameras.choice import ChosenCamera, PictureFacts, choose_camera
from pipeline.ingest.cameras.known_cameras import KnownCamera, known_cameras
from pipeline.ingest.video.metadata import camera_names
from tests.videos import write_video

ROOT = Path(__file__).parents[3]


def chosen(name: str, size: tuple[int, int], focal_mm: float = 0.0) -> ChosenCamera:
    return choose_camera(
        CameraSource(), PictureFacts(*size, "mission.yaml streams.a", (name,), None, focal_mm)
    )


def test_the_list_is_long_and_each_row_says_where_it_is_from_and_how_sure_it_is() -> None:
    rows = known_cameras()
    names = [name for row in rows for name in row.names]
    assert len({row.camera for row in rows}) == len(rows) >= 25
    assert len(set(names)) >= 25
    for row in rows:
        assert any(word in row.source for word in ("[T]", "[U]", "[O]", "maker", "XMP")), row.camera
        assert 0.015 <= row.focal_sd <= 0.05
        assert row.stills[0] > row.stills[1]


@pytest.mark.parametrize("row", known_cameras(), ids=lambda row: row.camera)
def test_a_row_agrees_with_the_equivalent_focal_length_that_its_maker_states(row: KnownCamera) -> None:
    """A slip of the pen in a row is far larger than what makers round."""
    by_maker = row.equivalent / math.hypot(36.0, 24.0) * math.hypot(*row.stills) / row.stills[0]
    assert abs(row.focal_over_width / by_maker - 1.0) < 0.06


def test_names_that_share_a_row_of_another_lens_are_told_apart_by_size_or_focal_length() -> None:
    for row in known_cameras():
        for other in known_cameras():
            if row is not other and {n.lower() for n in row.names} & {n.lower() for n in other.names}:
                assert bool(row.only) != bool(other.only)


@pytest.mark.parametrize(
    ("name", "size", "focal_px"),
    [
        ("FC6310", (5472, 3648), 3661), ("DJI FC6310", (2736, 1824), 1830), ("fc6310", (5472, 3648), 3661),
        ("Hasselblad L2D-20c", (5280, 3956), 3643), ("DJI Mini 4 Pro", (8064, 6048), 5790),
        ("Skydio 2", (4056, 3040), 2389),
        ("M3T", (640, 512), 758), ("DJI M30T", (1280, 1024), 1516), ("ZH20T", (640, 512), 1112),
        ("FC3682", (3000, 4000), 2892),
    ],
)  # fmt: skip
def test_whole_pictures_of_a_known_camera_have_its_focal_length(
    name: str, size: tuple[int, int], focal_px: float
) -> None:
    found = chosen(name, size)
    assert found.camera.fx == found.camera.fy == pytest.approx(focal_px, abs=1.0)
    assert (found.camera.cx, found.camera.cy) == (size[0] / 2, size[1] / 2)
    assert 0.015 <= found.camera.focal_sd <= 0.05
    assert "known by its name" in found.assumed[0]
    assert "source: " in found.assumed[0]


def test_a_video_is_a_part_of_the_sensor_and_less_sure_by_that() -> None:
    still, video = chosen("FC330", (4000, 3000)).camera, chosen("FC330", (3840, 2160)).camera
    assert video.fx / video.width == pytest.approx(1.03 * still.fx / still.width)
    assert video.focal_sd == pytest.approx(math.hypot(still.focal_sd, 0.05))
    narrow = chosen("FC6310", (4864, 3648)).camera  # 4:3 of a sensor of 3:2: its whole height
    assert narrow.fx == pytest.approx(1.03 * 0.669 * 5472)
    crop_mode = chosen("L1D-20c", (3840, 2160)).camera
    assert crop_mode.focal_sd > 0.2


@pytest.mark.parametrize(
    "name",
    [
        "FC9999",
        "FC63100",
        "FC631",
        "Mini 3 Pro Max",
        "DJI",
        "",
        "Mini",
        "FC6310 FC330",
        "HERO8 Black",
        "X2",
        "M3",
    ],
)
def test_a_name_that_is_not_in_the_list_is_asked_about_and_never_taken_for_the_nearest(name: str) -> None:
    with pytest.raises(
        InputError, match=r"no focal length in the metadata, of a camera called .*field_of_view"
    ) as caught:
        chosen(name, (4000, 3000))
    assert str(caught.value).count("\n") == 0
    assert repr(name) in str(caught.value)


def test_near_names_are_different_cameras() -> None:
    mini, pro = chosen("DJI Mini 3", (4000, 3000)), chosen("DJI Mini 3 Pro", (4000, 3000))
    assert "a DJI Mini 3," in mini.assumed[0]
    assert "a DJI Mini 3 Pro," in pro.assumed[0]
    assert mini.camera.fx != pro.camera.fx


@pytest.mark.parametrize("name", ["M3E", "M3T", "ZH20T", "M4T", "FC2403"])
def test_a_name_of_several_lenses_needs_a_focal_length_that_tells_which(name: str) -> None:
    with pytest.raises(InputError, match="is one of several of that name, and no focal length"):
        chosen(name, (3840, 2160))
    assert "known by its name" in chosen(name, (3840, 2160), 24.0).assumed[0]
    tele = chosen(name, (4000, 3000), 162.0)  # the other lens: by what its metadata say alone
    assert "known by its name" not in tele.assumed[0]
    assert tele.camera.fx == pytest.approx(162.0 / math.hypot(36, 24) * 5000.0)


def test_a_lens_that_zooms_needs_a_focal_length_and_belongs_to_its_widest() -> None:
    with pytest.raises(InputError, match="which zooms, and no focal length"):
        chosen("FC2204", (4000, 3000))
    zoomed = chosen("FC2204", (4000, 3000), 48.0)
    assert zoomed.focal_length_35mm == 24.0
    assert zoomed.camera.fx == pytest.approx(0.7 * 4000)


def test_a_focal_length_that_is_the_lens_s_own_rounded_otherwise_is_no_zoom() -> None:
    assert chosen("FC330", (4000, 3000), 21.0).focal_length_35mm == 21.0
    assert chosen("FC330", (4000, 3000), 40.0).focal_length_35mm == 20.0


def test_a_focal_length_below_what_the_lens_can_is_asked_about() -> None:
    with pytest.raises(
        InputError, match=r"a focal length of 8.8 mm, of a DJI Phantom 4 Pro .*whose least is 24 mm"
    ):
        chosen("FC6310", (5472, 3648), 8.8)


@pytest.mark.parametrize(
    ("encoder", "names"),
    [("DJI Air 2S", ("DJI Air 2S",)), ("Skydio 2", ("Skydio 2",)), ("HandBrake", ()), ("", ())],
)
def test_a_container_tells_the_drone_where_others_name_their_encoder(
    tmp_path: Path, encoder: str, names: tuple[str, ...]
) -> None:
    path = write_video(tmp_path / "a.mp4", 5)
    # FFmpeg writes its own name there
    data = re.sub(rb"Lavf[0-9.]+", lambda own: encoder.encode().ljust(len(own[0]), b"\0"), path.read_bytes())
    path.write_bytes(data)
    assert camera_names(path) == names


def test_a_model_in_quicktime_s_metadata_has_its_maker_once(tmp_path: Path) -> None:
    options = {"movflags": "use_metadata_tags"}
    tags = {"com.apple.quicktime.make": "DJI", "com.apple.quicktime.model": "FC3411"}
    path = write_video(tmp_path / "a.mov", 5, metadata=tags, container_options=options)
    assert camera_names(path)[0] == "DJI FC3411"
    assert camera_names(tmp_path / "none.mov") == ()


def test_the_page_lists_every_camera_as_the_list_has_it() -> None:
    page = (ROOT / "docs/cameras.md").read_text(encoding="utf-8")
    for row in known_cameras():
        assert (
            f"| {row.camera} | {', '.join(row.names)} | {row.focal_over_width:g} | {row.focal_sd:.1%} |"
            in page
        )
