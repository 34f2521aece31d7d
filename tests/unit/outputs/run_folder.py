"""The directory of a small finished run, written by the writers that a real run uses."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
from PIL import Image
from synthetic_search import FRAME, START_NS, location, search_of

from pipeline.geo.heights import Heights
from pipeline.geo.search_area import SearchArea
from pipeline.ingest.in_file import InFile
from pipeline.outputs.map_picture import map_picture, png
from pipeline.outputs.place_picture import PlacePicture
from pipeline.outputs.saliency_tif import write_saliency
from pipeline.outputs.salient_geojson import write_salient
from pipeline.outputs.second_look_files import write_second_look
from pipeline.outputs.summary import write_summary
from pipeline.outputs.ways_geojson import write_search_area, write_tracks
from pipeline.second_look.areas import SecondLookArea

HOLE = np.array([[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]])
AREA = SearchArea(((6.0 * HOLE, HOLE),))


def picture_png(seed: int, size: int = 144) -> bytes:
    """Noise, in which a blur leaves nothing as it was."""
    pixels = np.random.default_rng(seed).integers(0, 256, (size, size, 3), dtype=np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG")
    return buffer.getvalue()


def write_run(folder: Path, mission: str = "Bear <valley> & creek", datum: str | None = "geoid") -> Path:
    """Three found places (ids 1 to 3), two possible ones (4, 5); returns the folder."""
    folder.mkdir(parents=True)
    data = search_of()
    found = tuple(
        dataclasses.replace(place, probability=p)
        for place, p in zip(data.summary.locations, (0.81, 0.97, 0.88), strict=True)
    )
    possible = (location(4, 3.0, -9.0, 0.41), location(5, -7.0, 8.0, 0.52))
    summary = dataclasses.replace(data.summary, locations=found, possible=possible, mission=mission)
    heights = Heights(datum)  # type: ignore[arg-type]
    pictures = [
        PlacePicture(
            k, picture_png(k), "drone-1", START_NS + k * 10**9, InFile("DJI_0001.MP4", 65.4 + k, 1962 + k)
        )
        for k in (1, 2, 4)
    ]
    (folder / "crops").mkdir()
    for picture in pictures:
        (folder / picture.path).write_bytes(picture.png)
    write_salient(folder / "salient.geojson", found, None, "utc", heights, None, pictures)
    write_salient(folder / "possible.geojson", possible, None, "utc", heights, None, pictures)
    write_saliency(folder / "saliency.tif", data.voxel_map)
    write_tracks(folder / "tracks.geojson", data.tracks, FRAME)
    write_search_area(folder / "search_area.geojson", AREA, FRAME)
    ring = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0], [0.0, 0.0]])
    areas = [
        SecondLookArea(1, {"low probability of detection": 25.0}, 25.0, 0.01, (ring,), ring),
        SecondLookArea(2, {"nobody looked": 50.0}, 50.0, 0.01, (ring + 8.0, ring + 20.0), ring),
    ]
    write_second_look(folder / "second_look.geojson", areas, FRAME)
    (folder / "map.png").write_bytes(png(map_picture(data.voxel_map, data.tracks, found)))
    write_summary(folder / "summary.json", summary)
    return folder
