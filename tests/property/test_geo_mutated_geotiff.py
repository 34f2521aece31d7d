"""A damaged surface model is read or refused in one line: no traceback, no crash, no long wait, no great memory."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from pipeline.errors import InputError
from pipeline.geo.surface_model import inspect
from pipeline.geo.terrain import frame_of, load_terrain
from tests.mutations import Longest

SEED, MOST_S = 20_261_127, 2.0


def good(path: Path, compress: str | None, dtype: str) -> bytes:
    heights = (100.0 + np.add.outer(np.arange(64.0), np.arange(64.0))).astype(dtype)
    options = {"compress": compress, "tiled": True, "blockxsize": 32, "blockysize": 32}
    with rasterio.open(
        path, "w", driver="GTiff", width=64, height=64, count=1, dtype=dtype, crs="EPSG:32633",
        transform=from_origin(533_495.0, 6_473_682.0, 1.0, 1.0), nodata=-9999, **options,
    ) as target:  # fmt: skip
        target.write(heights, 1)
    return path.read_bytes()


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    result = bytearray(data)
    for _ in range(int(rng.integers(1, 12))):
        # most of it in the head, where the directory says what there is
        at = (
            int(rng.integers(min(len(result), 1200)))
            if rng.random() < 0.7
            else int(rng.integers(len(result)))
        )
        kind = rng.integers(4)
        if kind == 0:
            result[at] = int(rng.integers(256))
        elif kind == 1:
            result[at : at + 4] = rng.bytes(4)
        elif kind == 2:
            result[at : at + 4] = b"\xff\xff\xff\x7f"
        else:
            del result[max(at, 16) :]
    return bytes(result)


def read_all(folder: Path, count: int, first: int) -> tuple[int, int]:
    kinds = [good(folder / "good.tif", c, t) for c in (None, "deflate", "lzw") for t in ("float32", "int16")]
    path, read, refused, longest = folder / "dsm.tif", 0, 0, Longest(MOST_S)
    for number in range(first, first + count):
        rng = np.random.default_rng([SEED, number])
        path.write_bytes(mutated(kinds[number % len(kinds)], rng))
        with longest.of(number):
            try:
                terrain = load_terrain([inspect(path)], 1.0, frame_of(path), (-50.0, -50.0, 50.0, 50.0))
            except InputError as error:
                refused += str(error).count("\n") == 0
            else:
                assert np.nanmax(np.abs(terrain.heights_m)) < 10_000.0
                read += 1
    print(f"{read} read, {refused} refused, longest {longest.seconds:.2f} s")
    return read, refused


def test_a_mutated_geotiff_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    read, refused = read_all(tmp_path, 100, first=0)
    assert read + refused == 100
    assert min(read, refused) > 5


@pytest.mark.slow
def test_two_thousand_mutated_geotiffs(tmp_path: Path) -> None:
    assert sum(read_all(tmp_path, 2000, first=1000)) == 2000
