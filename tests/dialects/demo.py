"""The demo's true tracks, thinned as a dialect needs it, and the demo's mission with other telemetry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.track import Track

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs/missions/demo"
STREAMS = ("drone-1", "drone-2")


def true_track(stream: str) -> Track:
    """What a stream's drone really did, 30 samples a second; dates are UTC."""
    return replace(read_dji_srt(DEMO / f"{stream}.srt"), clock="utc")


def at_rate(track: Track, rate_hz: float) -> Track:
    """Of the samples of a track, those nearest to the ticks of a rate."""
    ticks = np.arange(track.times_s[0], track.times_s[-1] + 1e-6, 1.0 / rate_hz)
    kept = np.unique(np.abs(track.times_s[None] - ticks[:, None]).argmin(axis=1))
    arrays = {
        f.name: value[kept]
        for f in fields(track)
        if isinstance(value := getattr(track, f.name), np.ndarray) and len(value) == len(track.times_s)
    }
    return replace(track, **arrays, end_s=None)


def takeoff_height_m(track: Track) -> float:
    """Height of the take-off point above the datum."""
    return float(track.absolute_height_m[0] - track.relative_height_m[0])


def mission_with(
    folder: Path, telemetry: Mapping[str, Mapping[str, Any] | None], videos: Mapping[str, Path] | None = None
) -> Path:
    """The demo's mission in a folder, with the given telemetry of each stream (None: none), and other videos."""
    mission = yaml.safe_load((DEMO / "mission.yaml").read_text(encoding="utf-8"))
    mission["terrain"]["file"] = str(DEMO / "terrain.tif")
    mission["truth"] = str(DEMO / "truth/people.geojson")
    mission["inventory"] = str(ROOT / "configs/inventories/demo.yaml")
    mission["pool"] = str(ROOT / "configs/pools/demo.yaml")
    for stream in mission["streams"]:
        name = stream["id"]
        stream["video"] = str((videos or {}).get(name, DEMO / f"{name}.mp4"))
        stream["camera"] = str(DEMO / "camera.yaml")
        given = telemetry[name]
        if given is None:
            del stream["telemetry"]
        else:
            stream["telemetry"] = dict(given)
    path = folder / "mission.yaml"
    path.write_text(yaml.safe_dump(mission, sort_keys=False), encoding="utf-8")
    return path
