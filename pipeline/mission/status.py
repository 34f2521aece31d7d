"""Where a run stands, in words: while it flies, after it was cut off, and when it has ended."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from pipeline.errors import InputError
from pipeline.outputs.live_names import LIVE, REDUCER, STATUS
from pipeline.storage.claim import writer_of
from pipeline.storage.whole_or_nothing import SUMMARY_FILE, UNFINISHED

State = Literal["begins", "flies", "cut off", "ended", "ended early"]
#: what a run that flies writes once a second is older than this where it hangs, seconds
_SILENT_S = 5.0
#: events of the time line that are shown, the newest
_EVENTS = 8


@dataclass(frozen=True)
class RunStatus:
    """state: of the run. said: what its files say, as they are. lines: the same in words, the most important first."""

    state: State
    said: Mapping[str, Any]
    lines: tuple[str, ...]


def run_status(run: Path, now: datetime) -> RunStatus:
    """Where the run of a directory stands. now: with its zone. Raises InputError for a folder of no run."""
    writer = writer_of(run)
    if writer is None and (summary := _read(run / SUMMARY_FILE)) and not (run / LIVE).exists():
        return _ended(summary)
    if writer is None and not (run / UNFINISHED).exists() and not (run / LIVE).exists():
        raise InputError(run, "no run", "the --out of a `searchlight run`")
    status, reducer = _read(run / LIVE / STATUS), _read(run / LIVE / REDUCER)
    said = {"status": status, "map": reducer}
    if writer is None:
        return RunStatus("cut off", said, (*_cut_off(run, status), *_streams(status), *_map(reducer)))
    if not status:
        return RunStatus("begins", said, (f"the run begins (process {writer})", *_map(reducer)))
    head = f"{status['mission']} flies for {status['seconds']:g} s, pace {status['pace']} (process {writer})"
    parts = (head, *_silence(status, now), *_lost(status), *_map(reducer), *_streams(status), *_links(status))
    return RunStatus("flies", said, (*parts, *_machines(status), *_events(status)))


def _ended(summary: Mapping[str, Any]) -> RunStatus:
    partial = summary.get("partial")
    head = f"{summary['mission']} has ended: {summary['verdict']['sentence']}"
    lines = (head, *_streams({"streams": {s["stream"]: s for s in summary["streams"]}}), *_events(summary))
    return RunStatus("ended" if partial is None else "ended early", {"summary": summary}, lines)


def _cut_off(run: Path, status: Mapping[str, Any]) -> Iterator[str]:
    at = f", last heard of at {status['at']}" if status else ""
    again = "" if status.get("pace") == "realtime" else f"; to go on with it: searchlight run --resume {run}"
    yield f"the run was cut off: no process writes here{at}{again}"


def _silence(status: Mapping[str, Any], now: datetime) -> Iterator[str]:
    silent_s = (now - datetime.fromisoformat(status["at"])).total_seconds()
    if silent_s > _SILENT_S:
        yield f"WARNING: nothing was heard of it for {silent_s:.0f} s"


def _lost(status: Mapping[str, Any]) -> Iterator[str]:
    if lost := status.get("lost"):
        yield f"WARNING: lost at this moment: {', '.join(lost)}"


def _map(reducer: Mapping[str, Any]) -> Iterator[str]:
    if not reducer:
        return
    yield f"map of {reducer['at']}: {reducer['verdict']['sentence']}"
    yield f"places {reducer['places']}, possible places {reducer['possible']}"


def _streams(status: Mapping[str, Any]) -> Iterator[str]:
    for name, s in sorted(status.get("streams", {}).items()):
        parts = [f"captured {s['captured']}" + (f" of {s['in_all']}" if "in_all" in s else "")]
        parts += [f"processed {s['processed']}"]
        parts += [f"in flight {s['in_flight']}"] if s.get("in_flight") else []
        parts += [f"dropped {count} ({reason})" for reason, count in sorted(s["dropped"].items())]
        parts += [f"CONTRADICTION {s['contradiction']}"] if s.get("contradiction") else []
        yield f"{name}: {', '.join(parts)}" + (", ended" if s.get("finished") else "")


def _links(status: Mapping[str, Any]) -> Iterator[str]:
    for link in status.get("links", ()):
        if link["sent_bytes"] or link["down"]:
            rate = "unmeasured" if link["rate_bps"] is None else f"{link['rate_bps'] / 1e6:.2f} Mbps"
            down = f", DOWN: {'; '.join(sorted(set(link['down'].values())))}" if link["down"] else ""
            yield f"link {link['stream']} to {link['site']}: {rate}, {link['sent_bytes'] / 1e6:.1f} MB sent{down}"


def _machines(status: Mapping[str, Any]) -> Iterator[str]:
    for name, machine in sorted(status.get("machines", {}).items()):
        rejected = f", {machine['rejected']} rejected" if machine["rejected"] else ""
        yield f"machine {name}: {machine['waiting']} packets wait{rejected}"


def _events(status: Mapping[str, Any]) -> Iterator[str]:
    for entry in status.get("timeline", ())[-_EVENTS:]:
        yield f"{entry['at_s']:7.1f} s  {entry['what']} {entry['subject']} {entry['detail']}".rstrip()


def _read(path: Path) -> Any:
    """What a file of the run says; nothing, while there is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise InputError(path, f"what cannot be read ({error})", "a file that a run has written") from None
