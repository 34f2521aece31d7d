"""Pictures of one band are no ground, however many bits they have; ground is none the rougher for being real."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from rasterio.enums import ColorInterp
from rasterio.transform import from_origin
from scipy.ndimage import gaussian_filter

from pipeline.errors import InputError
from pipeline.geo import raster_content
from pipeline.geo.surface_model import inspect

SHARED = Path(__file__).parents[4] / "shared/data/images/four_people.jpg"
SIZE = 240


def write(path: Path, values: NDArray[Any], cell: float = 0.5, crs: str = "EPSG:32633", **given: Any) -> Path:
    tags = {key: given.pop(key) for key in ("descriptions", "colorinterp", "units") if key in given}
    origin = (15.0, 58.0) if crs == "EPSG:4326" else (533_000.0, 6_473_000.0)
    profile = {
        "driver": "GTiff", "width": values.shape[1], "height": values.shape[0], "count": 1, "dtype": values.dtype,
        "crs": crs, "transform": from_origin(*origin, cell, cell),
    }  # fmt: skip
    with rasterio.open(path, "w", **(profile | given)) as target:
        target.write(values, 1)
        for name, value in tags.items():
            setattr(target, name, value)
    return path


def photograph(seed: int = 1) -> NDArray[np.float64]:
    """0..1: soft patches, edges, and a sensor's noise."""
    rng = np.random.default_rng(seed)
    soft = gaussian_filter(rng.normal(size=(SIZE, SIZE)), 6.0)
    edges = gaussian_filter(rng.normal(size=(SIZE, SIZE)), 3.0) > 0.0
    values = 0.5 + 1.2 * soft + 0.15 * edges + rng.normal(0.0, 0.01, (SIZE, SIZE))
    return np.asarray(np.clip(values, 0.0, 1.0))


def scaled(most: float, dtype: str = "uint16") -> NDArray[Any]:
    return np.round(photograph() * most).astype(dtype)


PICTURES: dict[str, tuple[Callable[[], NDArray[Any]], dict[str, Any]]] = {
    "16 bits": (lambda: scaled(65535.0), {}),
    "14 bits": (lambda: scaled(16383.0), {}),
    "12 bits": (lambda: scaled(4095.0), {}),
    "10 bits of a fine orthophoto": (lambda: scaled(1023.0), {"cell": 0.03}),
    "8 bits in 16": (lambda: scaled(255.0), {}),
    "signed": (lambda: scaled(4095.0, "int16"), {}),
    "32 bits": (lambda: scaled(4095.0, "uint32"), {}),
    "12 bits as floating point": (lambda: scaled(4095.0).astype(np.float32), {}),
    "a satellite's, 10 m": (lambda: scaled(10_000.0), {"cell": 10.0}),
    "thermal, hundredths of a kelvin": (lambda: np.round(28_000.0 + 2500.0 * photograph()).astype(np.uint16), {}),
    "thermal, tenths of a kelvin": (lambda: np.round(2800.0 + 250.0 * photograph()).astype(np.uint16), {"cell": 0.1}),
    "reflectance that says so": (lambda: photograph().astype(np.float32), {"descriptions": ("NIR reflectance",)}),
    "shaded relief": (lambda: scaled(255.0).astype(np.float32), {"descriptions": ("hillshade",), "cell": 30.0}),
    "a band of red": (lambda: scaled(3.0), {"colorinterp": (ColorInterp.red,)}),
}  # fmt: skip


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_of_one_band_is_refused(tmp_path: Path, name: str) -> None:
    values, given = PICTURES[name]
    with pytest.raises(InputError, match=r"a picture, no surface model: (its band|its values|neighbouring)"):
        inspect(write(tmp_path / "picture.tif", values(), **given))


def test_a_real_photograph_in_16_bits_is_refused(tmp_path: Path) -> None:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    from PIL import Image

    gray = np.asarray(Image.open(SHARED).convert("L"), dtype=np.uint16)
    for factor in (1, 16, 257):
        with pytest.raises(InputError, match="a picture"):
            inspect(write(tmp_path / "picture.tif", (gray * factor).astype(np.uint16), 0.1))


def hills(height_m: float, sigma: float, seed: int = 2) -> NDArray[np.float64]:
    soft = gaussian_filter(np.random.default_rng(seed).normal(size=(SIZE, SIZE)), sigma, mode="wrap")
    return np.asarray(height_m * (soft - soft.min()) / (soft.max() - soft.min()))


def forest() -> NDArray[np.float64]:
    """Crowns of 20 m, with gaps, on a slope, half a metre of roughness."""
    rng = np.random.default_rng(3)
    crowns = 20.0 * (gaussian_filter(rng.normal(size=(SIZE, SIZE)), 4.0) > 0.02)
    return hills(60.0, 40.0) + crowns + rng.normal(0.0, 0.5, (SIZE, SIZE))


def city() -> NDArray[np.float64]:
    blocks = np.kron(np.random.default_rng(4).choice([0.0, 12.0, 25.0, 60.0], (24, 24)), np.ones((10, 10)))
    return np.asarray(30.0 + blocks)


def grass() -> NDArray[np.float64]:
    return 200.0 + np.random.default_rng(5).normal(0.0, 0.03, (SIZE, SIZE))


MODELS: dict[str, tuple[Callable[[], NDArray[Any]], dict[str, Any]]] = {
    "forest, half a metre": (lambda: forest().astype(np.float32), {}),
    "a city, 0.25 m": (lambda: city().astype(np.float32), {"cell": 0.25}),
    "grass, 2 cm": (lambda: grass().astype(np.float32), {"cell": 0.02}),
    "the Alps, 30 m": (lambda: (500.0 + hills(4000.0, 12.0)).astype(np.int16), {"cell": 1 / 3600, "crs": "EPSG:4326"}),
    "decimetres": (lambda: np.round(forest() * 10.0).astype(np.uint16), {"units": ("dm",)}),
    "whole metres, half a metre apart": (lambda: np.round(hills(40.0, 30.0)).astype(np.uint16), {}),
    "a coast and the sea's floor": (lambda: (hills(5000.0, 30.0) - 4500.0).astype(np.int16), {"cell": 450.0}),
    "a border that was resampled": (lambda: np.where(np.arange(SIZE) < 12, -9000.0, forest()).astype(np.float32), {}),
    "a flat sea": (lambda: np.zeros((SIZE, SIZE), np.float32), {}),
    "mostly unknown": (lambda: np.where(forest() > 75.0, forest(), -9999.0).astype(np.float32), {}),
    "called height": (lambda: forest().astype(np.float32), {"descriptions": ("DSM height (red line datum)"[:10],)}),
}  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
def test_rough_ground_is_ground(tmp_path: Path, name: str) -> None:
    values, given = MODELS[name]
    assert inspect(write(tmp_path / "dsm.tif", values(), **given)).path.name == "dsm.tif"


def test_a_raster_too_large_to_be_seen_whole_is_looked_at_here_and_there_its_border_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heights = (300.0 + forest()).astype(np.float32)
    heights[:20] = heights[:, :20] = 0.0
    monkeypatch.setattr(raster_content, "_MOST_CELLS", 10_000)
    (note,) = inspect(write(tmp_path / "dsm.tif", heights)).notes
    assert "zeros at the border" in note
