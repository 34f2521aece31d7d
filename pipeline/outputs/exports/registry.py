"""The formats that a run can be handed over in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from pipeline.outputs.exports.caltopo import write_caltopo
from pipeline.outputs.exports.cog import write_cog
from pipeline.outputs.exports.cot import write_cot
from pipeline.outputs.exports.csv_table import write_csv
from pipeline.outputs.exports.geojson import write_geojson
from pipeline.outputs.exports.gpkg import write_gpkg
from pipeline.outputs.exports.gpx import write_gpx
from pipeline.outputs.exports.kml import write_kml, write_kmz
from pipeline.outputs.exports.pdf import write_pdf
from pipeline.outputs.exports.view import RunView
from pipeline.storage.whole_or_nothing import make_folder


@dataclass(frozen=True)
class Format:
    """write: writes its files in a folder, whole or not at all, and names them. exact: it is nothing without exact
    positions, and cannot be redacted.
    """

    write: Callable[[Path, RunView], list[str]]
    exact: bool = False


FORMATS = {
    "geojson": Format(write_geojson),
    "kml": Format(write_kml),
    "kmz": Format(write_kmz),
    "gpx": Format(write_gpx),
    "csv": Format(write_csv),
    "cog": Format(write_cog, exact=True),
    "gpkg": Format(write_gpkg),
    "caltopo": Format(write_caltopo),
    "cot": Format(write_cot),
    "pdf": Format(write_pdf),
}


def formats_of(text: str) -> tuple[str, ...]:
    """The names in a list with commas, each once; ``all``: every one. Raises InputError for another name."""
    names = [name.strip().lower() for name in text.split(",") if name.strip()]
    if names == ["all"]:
        return tuple(FORMATS)
    for name in names:
        if name not in FORMATS:
            raise InputError("--to", repr(name), f"of {', '.join(FORMATS)}, or all")
    if not names:
        raise InputError("--to", "nothing", f"of {', '.join(FORMATS)}, or all")
    return tuple(dict.fromkeys(names))


def write_exports(folder: Path, view: RunView, formats: Sequence[str]) -> list[str]:
    """Write the formats in a folder, which is made; the names of their files, within it.

    No name of a file comes from the run. Raises InputError for a format that cannot be redacted, if the view is, and
    for one that the run has not what for.
    """
    for name in formats:
        if view.redacted and FORMATS[name].exact:
            raise InputError("--redact", f"{name}, which is nothing but exact positions", "other formats")
    make_folder(folder)
    return [file for name in formats for file in FORMATS[name].write(folder, view)]
