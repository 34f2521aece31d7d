from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.fusion.map_file import load_map, save_map
from pipeline.fusion.voxel_map import VoxelMap, log_odds
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain


def _map(cell_m: float = 0.5, folder: Path | None = None) -> VoxelMap:
    heights = np.zeros((600, 900), dtype=np.float32)
    return VoxelMap(Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, cell_m, heights), 0.1192, 0.971, folder)


def _raised(seed: int, folder: Path | None = None) -> VoxelMap:
    rng, voxel_map = np.random.default_rng(seed), _map(folder=folder)
    rows, columns = rng.integers(0, 300, 40), rng.integers(0, 900, 40)
    voxel_map.update(rows, columns, log_odds(rng.uniform(0.3, 0.9, 40)))
    return voxel_map


def _bytes(voxel_map: VoxelMap) -> bytes:
    return voxel_map.tiles.cells.tobytes() + voxel_map.tiles.touched.tobytes()


@pytest.mark.parametrize("on_disk", [False, True])
def test_a_loaded_map_is_the_saved_one(tmp_path: Path, on_disk: bool) -> None:
    saved, loaded = _raised(1, tmp_path if on_disk else None), _raised(2)
    save_map(tmp_path / "map", saved)
    load_map(tmp_path / "map", loaded)
    assert _bytes(loaded) == _bytes(saved)


def test_the_same_map_gives_the_same_file(tmp_path: Path) -> None:
    save_map(tmp_path / "a", _raised(1))
    save_map(tmp_path / "b", _raised(1))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_an_interrupted_save_leaves_the_last_good_map(tmp_path: Path) -> None:
    good, next_one = _raised(1), _raised(2)
    save_map(tmp_path / "map", good)
    touched = next_one.tiles.touched_tiles

    def until_the_power_fails():
        yield from list(touched())[:2]
        raise KeyboardInterrupt

    next_one.tiles.touched_tiles = until_the_power_fails  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        save_map(tmp_path / "map", next_one)
    loaded = _map()
    load_map(tmp_path / "map", loaded)
    assert _bytes(loaded) == _bytes(good)
    assert [p.name for p in tmp_path.iterdir()] == ["map"]


def _flip(data: bytes) -> bytes:
    return data[:-5000] + bytes([data[-5000] ^ 1]) + data[-4999:]


@pytest.mark.parametrize(
    ("spoil", "found"),
    [
        (_flip, "a file whose checksum does not fit"),
        (lambda data: data[: len(data) // 2], "a file whose checksum does not fit"),
        (lambda data: data + b"x", "a file whose checksum does not fit"),
        (lambda data: data[:20], "a file whose checksum does not fit"),
        (lambda data: b"", "another kind of file"),
        (lambda data: b"II*" + data[3:], "another kind of file"),
        (lambda data: data.replace(b"map 2", b"map 9", 1), "another kind of file"),
    ],
    ids=["a bit", "half", "more", "head", "empty", "tif", "version"],
)
def test_a_damaged_file_is_refused_and_the_map_stays_as_it_was(tmp_path: Path, spoil, found) -> None:
    save_map(tmp_path / "map", _raised(1))
    (tmp_path / "map").write_bytes(spoil((tmp_path / "map").read_bytes()))
    voxel_map = _raised(2)
    before = _bytes(voxel_map)
    with pytest.raises(InputError, match=found) as error:
        load_map(tmp_path / "map", voxel_map)
    assert str(error.value).startswith(f"{tmp_path}/map")
    assert "\n" not in str(error.value)
    assert _bytes(voxel_map) == before


def test_a_map_of_another_grid_is_refused_and_the_map_stays_as_it_was(tmp_path: Path) -> None:
    save_map(tmp_path / "map", _map(cell_m=0.25))
    voxel_map = _raised(2)
    before = _bytes(voxel_map)
    with pytest.raises(InputError, match=r"cell_m: found 0\.25; expected 0\.5"):
        load_map(tmp_path / "map", voxel_map)
    assert _bytes(voxel_map) == before


def test_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file"):
        load_map(tmp_path / "map", _map())
