"""The map as a Cloud Optimised GeoTIFF, of which a GIS reads over a network only what it shows."""

from __future__ import annotations

from pathlib import Path

import rasterio
from rasterio.shutil import copy

from pipeline.errors import InputError
from pipeline.outputs.exports.view import RunView
from pipeline.storage.whole_or_nothing import replacing


def write_cog(folder: Path, view: RunView) -> list[str]:
    """Write ``saliency.cog.tif``: all bands, names, units and values of ``saliency.tif``.

    Its overviews, which a GIS shows of a large map from afar, hold root mean squares: GDAL knows no overviews of
    greatest values, and a mean would hide a lone place more. Raises InputError where the run has no map.
    """
    if view.saliency is None:
        raise InputError("--to cog", "a run without saliency.tif", "the directory of a finished run")
    try:
        with replacing(folder / "saliency.cog.tif") as temporary, rasterio.open(view.saliency) as source:
            options = {"compress": "deflate", "predictor": "floating_point", "blocksize": 512}
            copy(source, temporary, driver="COG", overview_resampling="rms", **options)
    except rasterio.errors.RasterioIOError as error:
        raise InputError(view.saliency, f"a file that cannot be read ({error})"[:200], "a GeoTIFF") from None
    return ["saliency.cog.tif"]
