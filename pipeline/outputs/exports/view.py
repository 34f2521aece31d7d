"""A run as all formats see it: read from its directory once, so that all of them say the same."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal
from zoneinfo import ZoneInfo

from pipeline.errors import InputError
from pipeline.geo.grids import Utm, mgrs_of, utm_of
from pipeline.outputs.exports.decided_cells import Shift
from pipeline.storage.versions import require_version

Kind = Literal["found", "possible"]
State = Literal["", "confirmed", "rejected", "contradicted"]
#: the folder of a run directory for other tools' formats
EXPORTS = "exports"
#: longitude and latitude, WGS84, degrees
Point = tuple[float, float]


@dataclass(frozen=True)
class Ellipse:
    """semi_major_m >= semi_minor_m: at 95 %. orientation_deg: of the long axis, clockwise from north."""

    semi_major_m: float
    semi_minor_m: float
    orientation_deg: float


@dataclass(frozen=True, eq=False)
class PictureOf:
    """png: the file's bytes. stream, time: by whom and when (ISO 8601). file, file_s, frame: where in the video."""

    png: bytes = field(repr=False)
    stream: str
    time: str
    file: str | None = None
    file_s: float | None = None
    frame: int | None = None


@dataclass(frozen=True, eq=False)
class Place:
    """A found place, or a possible one, below the threshold.

    rank: from 1, by probability, the found ones first. latitude_deg, longitude_deg: WGS84. ellipsoidal_m: above
    WGS84's ellipsoid; height_m: above height_datum, the terrain's; None: not known, or left out. error: of the
    position; None: left out. first_seen, last_seen: ISO 8601 on ``clock``, ``UTC`` or another. state: what reviewers
    have decided, who and when in ``decided``, a sentence each.
    """

    id: int
    rank: int
    kind: Kind
    class_name: str
    probability: float
    latitude_deg: float
    longitude_deg: float
    ellipsoidal_m: float | None
    height_m: float | None
    height_datum: str
    error: Ellipse | None
    first_seen: str
    last_seen: str
    clock: str
    looks: int
    sightings: int
    streams: tuple[str, ...]
    setups: tuple[str, ...]
    expected_people: float
    may_be: tuple[int, ...]
    pictures: tuple[PictureOf, ...]
    mgrs_digits: int = 5
    state: State = ""
    decided: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Short, for a map: ``Place 3 (88 %)``."""
        state = f", {self.state}" if self.state else ""
        return f"{'Place' if self.kind == 'found' else 'Possible place'} {self.id} ({self.probability:.0%}{state})"

    @property
    def position(self) -> str:
        """Latitude and longitude for people: with no more decimals than are meant."""
        decimals = 7 if self.mgrs_digits == 5 else 2
        return f"{self.latitude_deg:.{decimals}f}, {self.longitude_deg:.{decimals}f}"

    @property
    def mgrs(self) -> str:
        """The square that it lies in."""
        return mgrs_of(self.latitude_deg, self.longitude_deg, self.mgrs_digits)

    @property
    def utm(self) -> Utm | None:
        """None in polar regions."""
        return utm_of(self.latitude_deg, self.longitude_deg)


@dataclass(frozen=True, eq=False)
class Shape:
    """A line or an area. parts: polygons, each of rings, or of one line. why: of a second look, reason -> m2."""

    name: str
    geometry: dict[str, Any]
    why: str = ""


@dataclass(frozen=True, eq=False)
class RunView:
    """mission: its name. verdict: the sentence that says what all of it means. made_at: of the export, UTC.

    places: the found ones, then the possible ones, each the most probable first. areas: to be searched. saliency,
    map_png: files, None where there is none or it is left out. limits: assumptions, warnings, a sentence each.
    redacted: what was left out, a sentence; empty: nothing. absent: what the directory lacks, a sentence
    each. time_zone: that people read times in; None: UTC. shifts: of the map's cells, by what was decided.
    """

    mission: str
    verdict: str
    made_at: datetime
    places: tuple[Place, ...]
    areas: tuple[Shape, ...]
    tracks: tuple[Shape, ...]
    second_look: tuple[Shape, ...]
    saliency: Path | None
    map_png: Path | None
    limits: tuple[str, ...] = ()
    redacted: str = ""
    absent: tuple[str, ...] = ()
    time_zone: ZoneInfo | None = None
    shifts: tuple[Shift, ...] = ()

    @property
    def layers(self) -> dict[str, tuple[Path, tuple[Shift, ...]]]:
        """The map's files: by the end of their name, which is empty for the first class and ``-CLASS`` for every other
        one; each with what was decided of its places.
        """
        if self.saliency is None:
            return {}
        others = {
            path.stem.removeprefix(self.saliency.stem): path
            for path in sorted(self.saliency.parent.glob(f"{self.saliency.stem}-*.tif"))
        }
        first = tuple(s for s in self.shifts if f"-{s.class_name}" not in others)
        return {"": (self.saliency, first)} | {
            end: (path, tuple(s for s in self.shifts if f"-{s.class_name}" == end))
            for end, path in others.items()
        }

    @property
    def found(self) -> tuple[Place, ...]:
        """The found places."""
        return tuple(place for place in self.places if place.kind == "found")

    @property
    def possible(self) -> tuple[Place, ...]:
        """The possible ones."""
        return tuple(place for place in self.places if place.kind == "possible")


def read_run(folder: Path, made_at: datetime) -> RunView:
    """Read a finished run's directory. Raises InputError if it is none, or if a file of it cannot be used."""
    summary = _json(folder / "summary.json", "the directory of a finished run")
    require_version(summary, "summary", folder / "summary.json")
    kinds: tuple[tuple[Kind, str], ...] = (("found", "salient.geojson"), ("possible", "possible.geojson"))
    places = [
        (kind, folder / name, feature)
        for kind, name in kinds
        for feature in features_of(folder / name, "places")
    ]
    absent = [
        n for n in ("tracks.geojson", "search_area.geojson", "saliency.tif") if not (folder / n).is_file()
    ]
    saliency, picture = folder / "saliency.tif", folder / "map.png"
    return RunView(
        str(summary["mission"]),
        str(summary["verdict"]["sentence"]),
        made_at,
        places_of(places, folder),
        _shapes(folder / "search_area.geojson", "search area"),
        _shapes(folder / "tracks.geojson", "tracks"),
        _shapes(folder / "second_look.geojson", "second look"),
        saliency if saliency.is_file() else None,
        picture if picture.is_file() else None,
        tuple(_limits(summary)),
        absent=tuple(f"the run directory has no {name}" for name in absent),
        time_zone=_zone(summary.get("time_zone"), folder / "summary.json"),
    )


def _zone(name: Any, path: Path) -> ZoneInfo | None:
    try:
        return None if name is None else ZoneInfo(name)
    except (KeyError, ValueError, TypeError, OSError):
        found = f"time_zone {str(name)[:40]!r}"
        raise InputError(path, found, "a name of the IANA data base, or null") from None


def features_of(path: Path, kind: str) -> list[dict[str, Any]]:
    """The features of a GeoJSON file of ours. Raises InputError where it is none."""
    document = _json(path, f"GeoJSON of a run ({kind})")
    require_version(document, kind, path)
    features = document.get("features")
    if not isinstance(features, list):
        raise InputError(path, "no features", "a FeatureCollection")
    return features


def places_of(features: list[tuple[Kind, Path, dict[str, Any]]], folder: Path) -> tuple[Place, ...]:
    """Places of GeoJSON features, in the order in which they are to be looked at."""
    return ranked([_place(kind, path, feature, folder) for kind, path, feature in features])


def ranked(places: Iterable[Place]) -> tuple[Place, ...]:
    """In the order in which they are to be looked at, each with its rank."""
    ordered = sorted(places, key=lambda place: (place.kind == "possible", -place.probability, place.id))
    return tuple(replace(place, rank=rank) for rank, place in enumerate(ordered, start=1))


def _place(kind: Kind, path: Path, feature: dict[str, Any], folder: Path) -> Place:
    try:
        said, point = feature["properties"], feature["geometry"]["coordinates"]
        error = said["error_ellipse"]
        return Place(
            int(feature["id"]),
            0,
            kind,
            str(said["class"]),
            float(said["probability"]),
            float(point[1]),
            float(point[0]),
            float(point[2]) if len(point) > 2 else None,
            float(said["height_m"]),
            str(said["height_datum"]),
            Ellipse(*(float(error[k]) for k in ("semi_major_m", "semi_minor_m", "orientation_deg"))),
            str(said["seen_from"]),
            str(said["seen_to"]),
            str(said["clock"]),
            int(said["looks"]),
            int(said["sightings"]),
            tuple(map(str, said["streams"])),
            tuple(map(str, said["setups"])),
            float(said["expected_people"]),
            tuple(map(int, said["may_be_same_person_as"])),
            tuple(_picture(path, folder, one) for one in said.get("pictures", ())),
        )
    except (KeyError, IndexError, TypeError, ValueError) as fault:
        raise _not_a_place(path, fault) from None


def _not_a_place(path: Path, fault: Exception) -> InputError:
    return InputError(
        path, f"a feature that is no place ({type(fault).__name__}: {fault})", "places of a run"
    )


def _picture(path: Path, folder: Path, said: dict[str, Any]) -> PictureOf:
    name = str(said["picture"])
    file = folder / name
    # what the file names must not reach out of the directory
    if not file.resolve().is_relative_to(folder.resolve()):
        raise InputError(path, f"a picture outside of the run directory: {name[:80]!r}", "one within it")
    try:
        png = file.read_bytes()
    except OSError as error:
        raise InputError(file, f"a picture that cannot be read ({error.strerror})", "a PNG") from None
    where = said.get("file"), said.get("file_s"), said.get("frame")
    return PictureOf(png, str(said["stream"]), str(said["time"]), *where)


def _shapes(path: Path, kind: str) -> tuple[Shape, ...]:
    if not path.is_file():
        return ()
    shapes = []
    for feature in features_of(path, kind):
        said = feature.get("properties") or {}
        why = ", ".join(f"{name} ({m2:.0f} m²)" for name, m2 in said.get("reasons", {}).items())
        name = said.get("name") or f"Second look {feature.get('id')}"
        shapes.append(Shape(str(name), feature["geometry"], why))
    return tuple(shapes)


def _limits(summary: dict[str, Any]) -> list[str]:
    """What the map assumes, and what was noticed."""
    found = [f"{f['severity']}: {f['where']}: {f['found']}" for f in summary["findings"]]
    found += [str(sentence) for sentence in summary["own_detections"]]
    for stream, counts in summary["telemetry_left_out"].items():
        found += [f"{stream}: telemetry left out: {reason}: {count}" for reason, count in counts.items()]
    return found


def _json(path: Path, expected: str) -> dict[str, Any]:
    try:
        document = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise InputError(path, "no file", expected) from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(path, f"a file that cannot be read ({type(error).__name__})", expected) from None
    if not isinstance(document, dict):
        raise InputError(path, f"a {type(document).__name__}", expected)
    return document
