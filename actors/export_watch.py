"""Follows a run that flies: whenever its places were written again, so are the files, and new events go out."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from actors.cot_sender import CotSender
from actors.drone_events import DroneEvents
from pipeline.errors import InputError
from pipeline.outputs.exports.cot import event_of, gone_event, uid_of
from pipeline.outputs.exports.live import live_state, read_live
from pipeline.outputs.exports.registry import FORMATS, write_exports
from pipeline.outputs.exports.view import Place, RunView, read_run
from pipeline.storage.whole_or_nothing import SUMMARY_FILE

#: between two looks at the run's directory, seconds
LOOK_EVERY_S = 0.25
#: formats that a flying run has what for
LIVE_FORMATS = tuple(name for name in FORMATS if name not in ("cog", "pdf"))


@dataclass(frozen=True)
class Wanted:
    """folder: where files go. formats: which. change: what is done to a view first, such as to redact it."""

    run: Path
    folder: Path
    formats: tuple[str, ...]
    change: Callable[[RunView], RunView]


class Follower:
    """Hands over what changed. sender: None sends nothing."""

    def __init__(self, wanted: Wanted, sender: CotSender | None, say: Callable[[str], None]) -> None:
        self._wanted, self._sender, self._say = wanted, sender, say
        self._state: tuple[int, int] | None = None
        self._sent: dict[str, tuple[object, ...]] = {}
        self._fault = ""
        self._drones = DroneEvents(wanted.run)

    async def follow(self) -> RunView:
        """Until the run is finished; its view then, which is handed over too. A run that begins later is waited for."""
        while True:
            state = live_state(self._wanted.run)
            if state is None and (self._wanted.run / SUMMARY_FILE).is_file():
                view = self._wanted.change(read_run(self._wanted.run, datetime.now(UTC)))
                self._hand_over(view, self._wanted.formats)
                return view
            if state is not None and state != self._state:
                self._look(state)
            await asyncio.sleep(LOOK_EVERY_S)

    def _look(self, state: tuple[int, int]) -> None:
        live = tuple(name for name in self._wanted.formats if name in LIVE_FORMATS)
        try:
            view = read_live(self._wanted.run, datetime.now(UTC))
            if view is not None:
                self._hand_over(self._wanted.change(view), live)
            self._state, self._fault = state, ""
        except (InputError, OSError) as error:
            # the run may have ended meanwhile; what stays wrong is told once
            if str(error) != self._fault:
                self._say(f"not handed over: {error}")
            self._fault = str(error)

    def _hand_over(self, view: RunView, formats: tuple[str, ...]) -> None:
        if self._sender is not None:
            self._send(view, self._sender)
        write_exports(self._wanted.folder, view, formats)
        self._say(f"{len(view.found)} places, {len(view.possible)} possible: handed over")

    def _send(self, view: RunView, sender: CotSender) -> None:
        """Events of places that are new or were changed; those that are gone are taken away."""
        now = {uid_of(view, place.id): place for place in view.places}
        events = {
            uid: event_of(place, view) for uid, place in now.items() if self._sent.get(uid) != _shown(place)
        }
        events |= {uid: gone_event(uid, view.made_at) for uid in self._sent if uid not in now}
        self._sent = {uid: _shown(place) for uid, place in now.items()}
        events |= self._drones.now(view)
        if events:
            sender.put(events)


def _shown(place: Place) -> tuple[object, ...]:
    """What a marker says: an event is sent again when it changes."""
    error = place.error
    size = None if error is None else round(error.semi_major_m, 1)
    return place.kind, place.latitude_deg, place.longitude_deg, place.name, size, place.last_seen


async def with_sender(sender: CotSender | None, work: asyncio.Future[Any], drain_s: float) -> bool:
    """Do the work while the sender sends, then let it end; whether all was sent. drain_s: how long that may take."""
    if sender is None:
        await work
        return True
    sending = asyncio.ensure_future(sender.run())
    try:
        await asyncio.wait({work, sending}, return_when=asyncio.FIRST_COMPLETED)
        if sending.done():
            work.cancel()
            with suppress(asyncio.CancelledError):
                await work
            await sending
        await work
        drained = asyncio.ensure_future(sender.drained(drain_s))
        await asyncio.wait({drained, sending}, return_when=asyncio.FIRST_COMPLETED)
        if sending.done():
            drained.cancel()
            await sending
        return drained.result()
    finally:
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
