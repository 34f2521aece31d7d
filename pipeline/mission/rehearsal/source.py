"""The model of a source: it captures on its clock, follows its epoch, and sends into its links."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pipeline.mission.controller.events import LinkMeasure, SourceReport
from pipeline.mission.controller.orders import Send
from pipeline.mission.controller.substreams import PlanEpoch, Substream
from pipeline.mission.rehearsal.link import ModelLink
from pipeline.mission.rehearsal.packets import SentEnd, SentFrame
from pipeline.mission.rehearsal.process import Process
from pipeline.mission.rehearsal.timeline import Timeline

#: a link that is further behind takes no new frame
MAX_BACKLOG_S = 1.0
REPORT_S = 0.25
#: so many frames wait for a process that is late
CAUGHT_UP = 3


class ModelSource(Process):
    """links: by site. dropped: tick -> why no detector was sent it. sent: tick -> the substreams that were.

    The drone captures whether the process lives or not: frames that nobody took are counted as lost with the source.
    """

    def __init__(
        self,
        stream: str,
        timeline: Timeline,
        links: Mapping[str, ModelLink],
        report: Callable[[SourceReport], None],
        *,
        rate_hz: float,
        ticks: int,
    ) -> None:
        super().__init__(f"source:{stream}", timeline)
        self.stream, self.links = stream, links
        self.dropped: dict[int, str] = {}
        self.sent: dict[int, list[Substream]] = {}
        self.followed: list[tuple[float, PlanEpoch]] = []
        self._report, self._rate_hz, self._ticks = report, rate_hz, ticks
        self._forget()

    def start(self, incarnation: int) -> None:
        """A new process goes on at the frame of this moment."""
        super().start(incarnation)
        self._forget()
        for link in self.links.values():
            link.cut()
        self.every(1.0 / self._rate_hz, self._capture)
        self.every(REPORT_S, self.report)
        self.report()

    def kill(self) -> None:
        """What is in its links is lost with it."""
        super().kill()
        for link in self.links.values():
            link.cut()

    def send(self, order: Send) -> None:
        """Follow another epoch from the next frame on."""
        if self._ended or order.incarnation != self.incarnation:
            return
        if order.epoch.number > self._epoch.number:
            self._follow(order.epoch)
        if order.over:
            self._end()
        self.report()

    def report(self) -> None:
        """Say what it does."""
        links = tuple(
            LinkMeasure(site, link.rate_bps) for site, link in self.links.items() if self._uses(site, link)
        )
        number, tick = self._epoch.number, self._next_tick
        self._report(SourceReport(self.stream, self.incarnation, number, tick, self._ended, links))

    def _uses(self, site: str, link: ModelLink) -> bool:
        """A link is measured by what it carries; nothing is known of one that carries nothing."""
        return link.waiting_bits > 0.0 or any(o.assignment.site == site for o in self._epoch.substreams)

    def _forget(self) -> None:
        self._epoch = PlanEpoch(self.stream, -1)
        self._next_sequence: dict[Substream, int] = {}
        self._next_tick = int(self.timeline.now * self._rate_hz)
        self._ended = False

    def _follow(self, epoch: PlanEpoch) -> None:
        self.followed.append((self.timeline.now, epoch))
        for opened in self._epoch.substreams:
            if opened.key not in epoch.keys:
                self._close(opened.key, opened.assignment.site)
        for opened in epoch.substreams:
            self._next_sequence.setdefault(opened.key, 0)
        self._epoch = epoch

    def _close(self, key: Substream, site: str) -> None:
        self.links[site].send(SentEnd(key, self._next_sequence.pop(key)))

    def _capture(self) -> None:
        if self._ended:
            return
        last = min(int(self.timeline.now * self._rate_hz), self._ticks)
        # a process that was stopped wakes up near the frame of that moment: what it slept through is nobody's
        for tick in range(max(self._next_tick, last - CAUGHT_UP), last):
            self._offer(tick)
        self._next_tick = max(last, self._next_tick)
        if self._next_tick >= self._ticks:
            self._end()
            self.report()

    def _end(self) -> None:
        self._follow(PlanEpoch(self.stream, self._epoch.number))
        self._ended = True

    def _offer(self, tick: int) -> None:
        due = [o for o in self._epoch.substreams if tick % o.assignment.period == o.assignment.phase]
        reason = "not_assigned"
        for opened in due:
            link = self.links[opened.assignment.site]
            bits = opened.assignment.bitrate_bps / self._rate_hz
            if link.waiting_bits > MAX_BACKLOG_S * max(link.rate_bps, 1.0):
                reason = "link_full"
                continue
            key, sequence = opened.key, self._next_sequence[opened.key]
            self._next_sequence[key] += 1
            self.sent.setdefault(tick, []).append(key)
            link.send(SentFrame(key, sequence, tick, sequence % 20 == 0, bits))
        if tick not in self.sent:
            self.dropped[tick] = reason
