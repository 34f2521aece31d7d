"""Operating points of a later evaluation put into a pool that was measured before: times stay as they were."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.evaluation.pool.pool_file import operating_point_row
from pipeline.evaluation.pool.pool_tools import moved, read_document, write_document
from pipeline.evaluation.report.results import DetectorFile, Results, load_results


def put_operating_points(pool: Path, results: Path, out: Path) -> None:
    """Write the pool to out, each detector with the operating points that an evaluation found.

    results: results.json of an evaluation at the thresholds of the pool (``score_threshold`` of its detectors).
    Raises InputError for a detector of the pool that the evaluation has not measured, that is another file there,
    or has another threshold: what its boxes are worth is worth that much from one threshold on alone.
    """
    document, measured = read_document(pool), load_results(results)
    rows = [
        moved(row, pool.parent, out.parent)
        | {"operating_points": _points(f"{pool} detectors.{row['id']}", row, measured)}
        for row in document["detectors"]
    ]
    provenance = document.get("provenance", {}) | {"operating_points": _provenance(measured)}
    write_document(out, document | {"provenance": provenance, "detectors": rows})


def _points(where: str, row: dict[str, Any], measured: Results) -> list[dict[str, Any]]:
    found = _measured(where, row["id"], measured)
    if row.get("sha256") != found.sha256:
        raise InputError(
            f"{where}.sha256", f"{row.get('sha256')}", f"the file that was evaluated, {found.sha256}"
        )
    if row["score_threshold"] != found.score_threshold:
        raise InputError(
            f"{where}.score_threshold",
            f"{row['score_threshold']:g}",
            f"{found.score_threshold:g}, which the evaluation went by; its file can give score_threshold",
        )
    if not found.operating_points:
        raise InputError(where, "an evaluation without operating points", "one with transcoding")
    return [operating_point_row(point) for point in found.operating_points]


def _measured(where: str, name: str, measured: Results) -> DetectorFile:
    for detector in measured.detectors:
        if detector.id == name:
            return detector
    names = ", ".join(d.id for d in measured.detectors)
    raise InputError(where, "a detector that was not evaluated", f"one of {names}")


def _provenance(measured: Results) -> dict[str, Any]:
    p = measured.provenance
    return {
        "people": f"{p.people} in {p.pictures} pictures of {len(p.sequences)} sequences",
        "evaluation": p.evaluation,
        "evaluation_sha256": p.evaluation_sha256,
        "dataset_sha256": p.dataset_sha256,
        "versions": p.versions,
        "date": p.date,
        "command": "searchlight pool operating-points",
    }
