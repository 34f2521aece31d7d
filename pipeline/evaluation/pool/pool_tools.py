"""Pools side by side: shown as a table, merged into one, compared, carried over to other machines."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from pipeline.config.pool import Pool, PoolDetector, TimeOn, load_pool
from pipeline.errors import InputError
from pipeline.storage.whole_or_nothing import replacing

_TIMES = ("minimum", "mean", "p95", "maximum")


def shown(pool: Pool) -> list[tuple[str, ...]]:
    """A table, the first row its head: detector, accuracy from the least to the greatest bitrate, costs."""
    rows: list[tuple[str, ...]] = [
        ("detector", "accuracy", "at", "memory", "threshold", "time per frame: mean (maximum)", "shared by 2")
    ]
    for d in pool.detectors:
        points = sorted(d.accuracy, key=lambda point: point.bitrate)
        times = "; ".join(
            f"{t.machine} {1e3 * t.mean:.1f}"
            + ("" if t.maximum is None else f" ({1e3 * t.maximum:.1f})")
            + " ms"
            for t in d.times
        )
        two = next((f"x {s.factor:.2f}" for s in d.sharing if s.detectors == 2), "–")
        rows.append(
            (
                d.id,
                " ".join(f"{p.accuracy:.2f}" for p in points),
                f"{points[0].bitrate / 1e3:g} to {points[-1].bitrate / 1e3:g} kbps",
                f"{d.memory / 1e6:.0f} MB",
                f"{d.score_threshold:.2f}",
                times,
                two,
            )
        )
        if d.assumed is not None:
            rows.append((f"  {d.id}", f"assumed: {d.assumed}", "", "", "", "", ""))
    return rows


def merge(paths: list[Path], out: Path) -> None:
    """One pool of several, or a single one in another place, written to out; model paths follow.

    A detector that is in more than one pool must be the same file with the same accuracy; its times on other
    machines are added, and the worse slow-down is kept. Raises InputError where pools contradict each other.
    """
    documents = [(path, read_document(path)) for path in paths]
    merged: dict[str, dict[str, Any]] = {}
    for path, document in documents:
        for row in document["detectors"]:
            own = moved(row, path.parent, out.parent)
            known = merged.get(row["id"])
            merged[row["id"]] = own if known is None else _joined(known, own, path)
    single = documents[0][1].get("provenance", {})
    pool = {
        "provenance": {"merged": {str(p): d.get("provenance", {}) for p, d in documents}}
        if len(documents) > 1
        else single,
        "assumed": list(dict.fromkeys(text for _, d in documents for text in d.get("assumed", []))),
        "detectors": list(merged.values()),
    }
    write_document(out, pool)


def assume(
    path: Path, out: Path, *, machine: str, like: str, slower: float, detectors: tuple[str, ...] = ()
) -> None:
    """A pool for a machine type that could not be measured: so many times as slow as one that was.

    The pool says that it is assumed. detectors: those to keep, all if empty. Raises InputError for a detector
    or a machine type that the pool has not, or a machine type that is measured already.
    """
    document = read_document(path)
    rows = {row["id"]: moved(row, path.parent, out.parent) for row in document["detectors"]}
    kept = [_known(rows, name, f"{path} detectors") for name in detectors or rows]
    for row in kept:
        times = {t["machine"]: t for t in row["times"]}
        where = f"{path} detectors.{row['id']}.times"
        if machine in times:
            raise InputError(where, f"{machine}, which is measured", "a machine type that is not")
        measured = _known(times, like, where)
        row["times"].append(
            {"machine": machine}
            | {
                field: {"milliseconds": round(1e3 * slower * time_s, 3)}
                for field in _TIMES
                if (time_s := getattr(TimeOn.model_validate(measured), field)) is not None
            }
        )
    text = f"machine type {machine}: {slower:g} times as slow as {like}, which was measured"
    write_document(out, document | {"assumed": [*document.get("assumed", []), text], "detectors": kept})


def _known(rows: dict[str, Any], name: str, where: str) -> Any:
    if name not in rows:
        raise InputError(where, f"no {name}", f"one of {', '.join(sorted(rows))}")
    return rows[name]


def write_document(out: Path, pool: dict[str, Any]) -> None:
    """Write a pool file and read it back. Raises InputError if it could not be used."""
    with replacing(out) as temporary:
        temporary.write_text(yaml.safe_dump(pool, sort_keys=False, width=110), encoding="utf-8")
        load_pool(temporary)


def read_document(path: Path) -> Any:
    """What a pool file says, as it stands there. Raises InputError if it could not be used."""
    load_pool(path)
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def moved(row: dict[str, Any], old: Path, new: Path) -> dict[str, Any]:
    """A detector's row in a pool of another folder: its files' paths follow."""
    files = {k: os.path.relpath(old / row[k], new) for k in ("model", "card") if row.get(k) is not None}
    return row | files


def _joined(known: dict[str, Any], row: dict[str, Any], path: Path) -> dict[str, Any]:
    for field in ("sha256", "accuracy"):
        if known.get(field) != row.get(field):
            where = f"{path} detectors.{row['id']}.{field}"
            raise InputError(where, "another than in an earlier pool", "the same detector, or another id")
    times = {t["machine"]: t for t in known["times"]}
    for time in row["times"]:
        if times.setdefault(time["machine"], time) != time:
            where = f"{path} detectors.{row['id']}.times"
            raise InputError(where, f"other times on {time['machine']}", "each machine type in one pool")
    worst = {s["detectors"]: s for s in known.get("sharing", [])}
    for s in row.get("sharing", []):
        worst[s["detectors"]] = max(s, worst.get(s["detectors"], s), key=lambda x: x["factor"])
    joined = known | {"times": list(times.values())}
    return joined | ({"sharing": [worst[n] for n in sorted(worst)]} if worst else {})


def differences(old: Pool, new: Pool) -> Iterator[tuple[str, str, str, str]]:
    """Detector, field, old value, new value, wherever two pools differ; the paths of files do not count."""
    before, after = ({d.id: d for d in pool.detectors} for pool in (old, new))
    for name in sorted(before.keys() | after.keys()):
        if name not in before or name not in after:
            yield (
                name,
                "detector",
                "–" if name not in before else "there",
                "–" if name not in after else "there",
            )
        else:
            a, b = dict(_flat(before[name])), dict(_flat(after[name]))
            for field in sorted(a.keys() | b.keys()):
                if a.get(field) != b.get(field):
                    yield name, field, a.get(field, "–"), b.get(field, "–")


def _flat(d: PoolDetector) -> Iterator[tuple[str, str]]:
    yield "memory", f"{d.memory / 1e6:g} MB"
    yield "score_threshold", f"{d.score_threshold:g}"
    if d.calibration is not None:
        yield "calibration", f"scale {d.calibration.scale:g}, offset {d.calibration.offset:g}"
    yield "sha256", (d.sha256 or "–")[:12]
    for p in d.accuracy:
        yield f"accuracy at {p.bitrate / 1e3:g} kbps", f"{p.accuracy:.4g}"
    for s in d.accuracy_by_size:
        yield f"accuracy, {s.size}, at {s.bitrate / 1e3:g} kbps", f"{s.accuracy:.4g}"
    for c in d.accuracy_by_codec:
        yield f"accuracy, {c.codec}, at {c.bitrate / 1e3:g} kbps", f"{c.accuracy:.4g}"
    for x in d.accuracy_by_context:
        where = f"people from {x.person_px_from:g} px"
        yield f"accuracy, {where}, at {x.bitrate / 1e3:g} kbps", f"{x.accuracy:.4g}"
    for t in d.times:
        for field in _TIMES:
            value = getattr(t, field)
            if value is not None:
                yield f"{field} on {t.machine}", f"{1e3 * value:.4g} ms"
    for s2 in d.sharing:
        yield f"shared by {s2.detectors}", f"x {s2.factor:.3g}"
