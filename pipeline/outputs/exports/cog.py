"""The map as a Cloud Optimised GeoTIFF, of which a GIS reads over a network only what it shows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rasterio
from rasterio.shutil import copy

from pipeline.errors import InputError
from pipeline.outputs.exports.decided_cells import Shift, decided_cells
from pipeline.outputs.exports.view import RunView
from pipeline.storage.whole_or_nothing import replacing


def write_cog(folder: Path, view: RunView) -> list[str]:
    """Write ``saliency.cog.tif``: all bands, names, units and values of ``saliency.tif``, after what was decided; and
    ``saliency-CLASS.cog.tif`` of every further class.

    Its overviews, which a GIS shows of a large map from afar, hold root mean squares: GDAL knows no overviews of
    greatest values, and a mean would hide a lone place more. Raises InputError where the run has no map.
    """
    if view.saliency is None:
        raise InputError("--to cog", "a run without saliency.tif", "the directory of a finished run")
    return [_write(folder / f"saliency{end}.cog.tif", *layer) for end, layer in view.layers.items()]


def _write(path: Path, saliency: Path, shifts: tuple[Shift, ...]) -> str:
    try:
        with (
            replacing(path) as temporary,
            rasterio.open(saliency) as source,
            _decided(source, shifts) as decided,
        ):
            options = {"compress": "deflate", "predictor": "floating_point", "blocksize": 512}
            copy(decided, temporary, driver="COG", overview_resampling="rms", **options)
    except rasterio.errors.RasterioIOError as error:
        raise InputError(saliency, f"a file that cannot be read ({error})"[:200], "a GeoTIFF") from None
    return path.name


@contextmanager
def _decided(source: rasterio.DatasetReader, shifts: tuple[Shift, ...]) -> Iterator[rasterio.DatasetReader]:
    """The map after the decisions, in memory; itself where there are none."""
    if not shifts:
        yield source
        return
    with rasterio.MemoryFile() as memory:
        copy(source, memory.name, driver="GTiff")
        with rasterio.open(memory.name, "r+") as target:
            names = list(source.descriptions)
            bands = decided_cells(source, shifts)
            for name, band in zip(("probability", "log_odds"), bands, strict=True):
                target.write(band, names.index(name) + 1)
            target.update_tags(DECIDED=f"with what reviewers decided of {len(shifts)} places")
        with memory.open() as decided:
            yield decided
