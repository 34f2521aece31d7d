"""Finished work, kept by what it was made from and by which code: the same is never worked on twice."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import av
import numpy as np
import onnxruntime

from pipeline.evaluation.measuring.unit import Model, Unit
from pipeline.evaluation.measuring.work_unit import Found, UnitResult
from pipeline.storage.code_digest import code_sha256
from pipeline.storage.whole_or_nothing import write_bytes

#: the code that encoded streams depend on, and that which what was found depends on as well
_STREAM_CODE = (
    "pipeline.evaluation.measuring.transcoding",
    "pipeline.ingest.video",
    "pipeline.link.codec",
)
_FOUND_CODE = (
    "pipeline.config.layout",
    "pipeline.detection",
    "pipeline.evaluation.measuring.work_unit",
)


class Cache:
    """A folder of results. Files appear whole; one that cannot be read counts as absent."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def packets(self, unit: Unit, source_sha256: str) -> Path:
        """Where the encoded stream of a unit is kept."""
        return self._folder / "streams" / f"{_digest(_stream_key(unit, source_sha256))}.packets"

    def load(self, unit: Unit, source_sha256: str, model: Model) -> UnitResult | None:
        """The result of one detector, if it is there."""
        path = self._path(unit, source_sha256, model)
        try:
            with np.load(path, allow_pickle=False) as file:
                meta = json.loads(str(file["meta"]))
                found = Found(file["image"], file["boxes_px"], file["score"], **meta.pop("found"))
            return UnitResult(**meta, found={model.id: found})
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            return None

    def store(self, unit: Unit, source_sha256: str, result: UnitResult) -> None:
        """Keep the result of every detector of the unit."""
        for model in unit.models:
            found = result.found[model.id]
            meta = {
                "total_bytes": result.total_bytes,
                "largest_packet_bytes": result.largest_packet_bytes,
                "frames": result.frames,
                "seconds": result.seconds,
                "found": {"not_finite": found.not_finite, "detect_s": found.detect_s},
            }
            buffer = io.BytesIO()
            np.savez_compressed(
                buffer, meta=json.dumps(meta), image=found.image, boxes_px=found.boxes_px, score=found.score
            )
            path = self._path(unit, source_sha256, model)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, buffer.getvalue())

    def _path(self, unit: Unit, source_sha256: str, model: Model) -> Path:
        key = _stream_key(unit, source_sha256) | {
            "looked": sorted(unit.looked.items()),
            "model": model.sha256,
            "provider": model.provider,
            "onnxruntime": onnxruntime.__version__,
            "score_cutoff": unit.score_cutoff,
            "found_code": code_sha256(*_FOUND_CODE),
        }
        return self._folder / "found" / f"{_digest(key)}.npz"


def _stream_key(unit: Unit, source_sha256: str) -> dict[str, Any]:
    return {
        "code": code_sha256(*_STREAM_CODE),
        "source": source_sha256,
        "kept": unit.kept,
        "rate": unit.frame_rate_hz,
        "size": unit.size,
        "condition": asdict(unit.condition),
        "keyframe_interval": unit.keyframe_interval,
        "av": av.__version__,
        "ffmpeg": sorted(av.library_versions.items()),
    }


def _digest(key: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode("utf-8")).hexdigest()[:40]
