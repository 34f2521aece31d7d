"""Stills are pictures with irregular times: upright, each once, a broken file costs itself."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InputError
from pipeline.ingest.source import LostPicture, PassedPicture, Picture
from pipeline.ingest.video.stills import open_stills

TIMES_S = np.array([100.0, 102.0, 104.5, 110.0, 110.04, 112.0])


def write(path: Path, shade: int, size: tuple[int, int] = (64, 48), orientation: int = 1) -> Path:
    image = Image.fromarray(np.full((size[1], size[0], 3), shade, np.uint8))
    image.paste((250, 0, 0), (0, 0, size[0], size[1] // 4))
    exif = Image.Exif()
    exif[0x0112] = orientation
    image.save(path, exif=exif, quality=95)
    return path


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    return [write(tmp_path / f"{k}.jpg", 40 + 20 * k) for k in range(6)]


def shade(picture: Picture) -> float:
    return float(picture.image[24:].mean())


def test_each_still_is_taken_once_at_its_own_time(files: list[Path]) -> None:
    source = open_stills(tuple(files), TIMES_S)
    pictures = list(source.pictures(10.0))
    assert [p.index for p in pictures] == list(range(6))
    taken = [p for p in pictures if isinstance(p, Picture)]
    assert [p.time_s for p in taken] == pytest.approx([0.0, 2.0, 4.5, 10.0, 10.04, 12.0])
    assert [p.tick for p in taken] == [0, 20, 45, 100, 101, 120]
    assert [shade(p) for p in taken] == pytest.approx([40 + 20 * k for k in range(6)], abs=3.0)
    assert (source.info.width, source.info.height, source.info.pictures) == (64, 48, 6)
    assert not source.info.constant


def test_of_two_within_a_tick_one_is_taken(files: list[Path]) -> None:
    kinds = [type(p) for p in open_stills(tuple(files), TIMES_S).pictures(1.0)]
    assert kinds.count(PassedPicture) == 0
    kinds = [type(p) for p in open_stills(tuple(files), TIMES_S / 100.0).pictures(10.0)]
    assert kinds.count(PassedPicture) > 0


def test_files_in_any_order_are_sorted_by_time(files: list[Path]) -> None:
    source = open_stills(tuple(files[::-1]), TIMES_S[::-1])
    assert source.files == tuple(files)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_stills_are_upright(tmp_path: Path, orientation: int) -> None:
    source = open_stills((write(tmp_path / "s.jpg", 100, orientation=orientation),), np.zeros(1))
    image = next(p for p in source.pictures(1.0) if isinstance(p, Picture)).image.astype(int)
    assert image.shape[:2] == ((48, 64) if orientation in (1, 3) else (64, 48))
    edge = {1: image[:8], 3: image[-8:], 6: image[:, -8:], 8: image[:, :8]}[orientation]
    assert (edge[..., 0] - edge[..., 1]).mean() > 150
    ((_, full),) = source.images_at([0.0])
    assert np.abs(full.astype(int) - image).mean() < 6.0


def test_broken_missing_and_strange_files_cost_themselves(files: list[Path]) -> None:
    files[1].write_bytes(files[1].read_bytes()[:300])
    files[2].unlink()
    write(files[3], 90, size=(80, 48))
    files[4].write_text("no picture")
    pictures = list(open_stills(tuple(files), TIMES_S).pictures(10.0))
    lost = [(p.index, p.reason) for p in pictures if isinstance(p, LostPicture)]
    assert lost == [(1, "damaged"), (2, "missing"), (3, "damaged"), (4, "damaged")]
    assert [p.index for p in pictures if isinstance(p, Picture)] == [0, 5]


def test_png_and_tiff_of_sixteen_bits_are_stretched_to_eight(tmp_path: Path) -> None:
    hot = np.linspace(8000, 8400, 64 * 48).reshape(48, 64).astype(np.uint16)
    paths = [tmp_path / "thermal.png", tmp_path / "thermal.tiff"]
    for path in paths:
        Image.fromarray(hot).save(path)
    for picture in open_stills(tuple(paths), np.array([0.0, 1.0])).pictures(1.0):
        assert isinstance(picture, Picture)
        assert picture.image.min() < 10
        assert picture.image.max() > 245


def test_a_large_still_is_sent_small_and_cut_large(tmp_path: Path) -> None:
    source = open_stills((write(tmp_path / "s.jpg", 100, size=(1601, 1201)),), np.zeros(1))
    assert source.sent_size == (1600, 1200)
    (picture,) = source.resized(320, 240).pictures(1.0)
    assert isinstance(picture, Picture)
    assert picture.image.shape == (240, 320, 3)
    ((_, full),) = source.images_at([0.0])
    assert full.shape == (1201, 1601, 3)


def test_start_and_end_cut_and_nothing_at_all_is_refused(files: list[Path], tmp_path: Path) -> None:
    source = open_stills(tuple(files), TIMES_S, 2.0, 10.0)
    assert [p.index for p in source.pictures(10.0)] == [1, 2]
    with pytest.raises(InputError, match="a part of the stills, which last"):
        open_stills(tuple(files), TIMES_S, 50.0)
    (tmp_path / "x.jpg").write_text("no picture")
    with pytest.raises(InputError, match="no still that can be opened"):
        open_stills((tmp_path / "x.jpg",), np.zeros(1))


def test_planes_at_a_time_are_those_that_the_run_sends(files: list[Path]) -> None:
    source = open_stills(tuple(files), TIMES_S).resized(32, 24)
    sent = {p.time_s: p.planes.to_ndarray() for p in source.pictures(10.0) if isinstance(p, Picture)}
    files[3].unlink()
    times_s = (np.array(TIMES_S) - TIMES_S[0]).tolist()
    found = dict(source.planes_at([times_s[1], times_s[3], times_s[4], 1e6]))
    assert list(found) == [times_s[1], times_s[4]]
    for time_s, planes in found.items():
        np.testing.assert_array_equal(planes.to_ndarray(), sent[time_s])
