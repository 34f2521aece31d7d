"""The formats of telemetry: which there are, which one a file is in, and reading it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.telemetry.airdata_csv import is_airdata_csv, read_airdata_csv
from pipeline.ingest.telemetry.ardupilot_bin import is_ardupilot_bin, read_ardupilot_bin
from pipeline.ingest.telemetry.column_table import is_table, read_column_table
from pipeline.ingest.telemetry.dji_flight_record_csv import (
    is_dji_flight_record_csv,
    read_dji_flight_record_csv,
)
from pipeline.ingest.telemetry.dji_srt import is_dji_srt, read_dji_srt
from pipeline.ingest.telemetry.gopro_gpmf import is_gopro_gpmf, read_gopro_gpmf
from pipeline.ingest.telemetry.litchi_csv import is_litchi_csv, read_litchi_csv
from pipeline.ingest.telemetry.mavlink_tlog import is_mavlink_tlog, read_mavlink_tlog
from pipeline.ingest.telemetry.misb_klv import is_misb_klv, read_misb_klv
from pipeline.ingest.telemetry.not_decoded import require_decoded
from pipeline.ingest.telemetry.px4_ulog import is_px4_ulog, read_px4_ulog
from pipeline.ingest.telemetry.stills_metadata import is_stills, read_stills
from pipeline.ingest.telemetry.video_subtitles import (
    is_video,
    is_video_with_subtitles,
    read_video_subtitles,
    without_telemetry,
)
from pipeline.ingest.track import Track

#: a format is recognised by the file's name and so many of its first bytes
HEAD_BYTES = 65_536


@dataclass(frozen=True)
class TelemetryFormat:
    """name: in the mission file. title: for people. recognises(path, first bytes). read(telemetry)."""

    name: str
    title: str
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Telemetry], Track]


#: tried in this order; one file per format in ``pipeline/ingest/telemetry``
TELEMETRY_FORMATS = (
    TelemetryFormat(
        "dji-srt", "DJI subtitles (SRT)", is_dji_srt, lambda t: read_dji_srt(t.file, t.gps_order)
    ),
    TelemetryFormat(
        "video-subtitles",
        "DJI subtitles inside the video",
        is_video_with_subtitles,
        lambda t: read_video_subtitles(t.file, t.gps_order),
    ),
    TelemetryFormat("airdata-csv", "flight logs of Airdata (CSV)", is_airdata_csv, read_airdata_csv),
    TelemetryFormat("litchi-csv", "flight logs of Litchi (CSV)", is_litchi_csv, read_litchi_csv),
    TelemetryFormat(
        "dji-flight-record-csv",
        "DJI flight records, decoded (CSV)",
        is_dji_flight_record_csv,
        read_dji_flight_record_csv,
    ),
    # these by their first bytes, then those that can be found in the middle of a file
    TelemetryFormat("px4-ulog", "PX4 logs (.ulg)", is_px4_ulog, read_px4_ulog),
    TelemetryFormat("ardupilot-bin", "ArduPilot dataflash logs (.bin)", is_ardupilot_bin, read_ardupilot_bin),
    TelemetryFormat("gopro-gpmf", "GoPro GPMF (bare, or MP4 with it)", is_gopro_gpmf, read_gopro_gpmf),
    TelemetryFormat("mavlink-tlog", "MAVLink logs (.tlog)", is_mavlink_tlog, read_mavlink_tlog),
    TelemetryFormat("misb-klv", "MISB ST 0601 metadata (KLV, or TS with it)", is_misb_klv, read_misb_klv),
    TelemetryFormat(
        "stills-metadata", "a folder of stills (EXIF, XMP)", is_stills, lambda t: read_stills(t.file)
    ),
    # last: any other table, by the mission's map of its columns
    TelemetryFormat("table", "any table, with telemetry.columns", is_table, read_column_table),
)


def read_telemetry(telemetry: Telemetry) -> Track:
    """The samples of a telemetry file. Raises InputError if its format is not known or it cannot be read."""
    return format_of(telemetry).read(telemetry)


def format_of(telemetry: Telemetry) -> TelemetryFormat:
    """The format named in the mission, or the one that the file is in."""
    names = {known.name: known for known in TELEMETRY_FORMATS}
    if telemetry.format != "auto":
        if telemetry.format not in names:
            raise InputError("telemetry.format", repr(telemetry.format), f"auto or one of {', '.join(names)}")
        return names[telemetry.format]
    head = b"" if telemetry.file.is_dir() else _head(telemetry.file)
    require_decoded(telemetry.file, head)
    for known in TELEMETRY_FORMATS:
        if known.recognises(telemetry.file, head):
            return known
    if is_video(head):
        raise without_telemetry(telemetry.file)
    if telemetry.columns:
        return names["table"]  # the mission says that it is one, if of cells that only spaces part
    raise InputError(
        telemetry.file,
        "telemetry of an unknown format",
        f"one of {', '.join(known.title for known in TELEMETRY_FORMATS)}",
    )


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)
    except FileNotFoundError:
        raise InputError(path, "no file", "a telemetry file") from None
    except OSError as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", "a telemetry file") from None
