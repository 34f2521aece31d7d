"""The detector allocation problem: which detector looks at which frame of which stream, from where.

The paper's names (Table ilp_params): V streams, S sites, M machines, D detectors, B bitrate levels, F the
frames of one cycle. A *detector* here is one network on one machine, so the same network on two machines is
two detectors.

Solvers compute with whole numbers: gains and penalties in units of OBJECTIVE_RESOLUTION, memory in units of
MEMORY_RESOLUTION_BYTES, bitrates and bandwidths in bit/s (times cp_lcm, so that ``bitrate_b / period_d`` is
exact). A plan's own objective is computed from its assignments, not from the rounded numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from pipeline.link.codec import Codec
from pipeline.sensor.setup import PLAIN, Setup

MemoryRule = Literal["ram", "one_detector_per_machine"]

OBJECTIVE_RESOLUTION = 1e-9
MEMORY_RESOLUTION_BYTES = 1000.0
#: a deadline is missed by more than this
_TIME_TOLERANCE_S = 1e-9


@dataclass(frozen=True)
class Detector:
    """One network on one machine (d in D).

    id: ``MACHINE:DETECTOR``. detector: its id in the pool. period: frames from one start to the next, at
    least 1 (Eq. period). memory_bytes: ram_d. accuracy: acc_d^b in 0..1, one value per level of
    ``Problem.bitrates_bps``. execution_s: time on one frame; the paper's program only sees the period.
    sharing: its times hold while at most so many detectors run on its machine; None: however many do.
    setup: how it is run there.
    """

    id: str
    detector: str
    machine: str
    site: str
    period: int
    memory_bytes: float
    accuracy: tuple[float, ...]
    execution_s: float
    sharing: int | None = None
    setup: Setup = PLAIN


@dataclass(frozen=True)
class MachineLimit:
    """One machine (m in M) and ram_m. Infinite memory means no limit, under either memory rule."""

    id: str
    site: str
    memory_bytes: float


@dataclass(frozen=True)
class Deadline:
    """From the capture of a frame to its result, the way there included; past the paper.

    limit_s: the most that encoding, transfer, decoding and execution may take together. A frame has
    ``bitrate / frame_rate`` bits, and the largest packet of a stream burst times as many, at least 1.
    Within a site nothing is encoded, sent or decoded.
    """

    limit_s: float
    encode_s: float = 0.0
    decode_s: float = 0.0
    burst: float = 1.0


@dataclass(frozen=True)
class Problem:
    """Everything that a solver reads.

    bitrates_bps: the levels b in B, finite and positive, ascending. link_bps: link_bw_v^s by (stream, site);
    a missing pair is 0 and forbids, infinity is the stream's own site. frame_rate_hz: processingFrameRate.
    detectors_per_stream, detectors_per_frame: detPerStream, detPerFrame. accuracy_weight: w in 0..1.
    memory_rule: ``ram`` is Eq. ilp_contr_ram, ``one_detector_per_machine`` is Eq. ilp_contr_ram_simpl.

    Past the paper: stream_accuracy replaces a detector's accuracy for one stream, by (stream, id in the
    pool). deadline: see there. codecs: of each level, where levels are bitrates times codecs (the bitrates
    then ascend, each several times); empty where there is but one codec.
    """

    streams: tuple[str, ...]
    sites: tuple[str, ...]
    machines: tuple[MachineLimit, ...]
    detectors: tuple[Detector, ...]
    bitrates_bps: tuple[float, ...]
    link_bps: Mapping[tuple[str, str], float]
    frame_rate_hz: float
    detectors_per_stream: int
    detectors_per_frame: int
    accuracy_weight: float
    memory_rule: MemoryRule = "ram"
    stream_accuracy: Mapping[tuple[str, str], tuple[float, ...]] = field(default_factory=dict)
    deadline: Deadline | None = None
    codecs: tuple[Codec | Literal[""], ...] = ()

    @cached_property
    def cycle(self) -> int:
        """cp_lcm: the frames after which every schedule repeats, the least common multiple of the periods."""
        return math.lcm(*(detector.period for detector in self.detectors))

    def link(self, stream: str, site: str) -> float:
        """link_bw_v^s, bits per second: 0 without a link, infinite at the stream's own site."""
        return self.link_bps.get((stream, site), 0.0)

    def codec(self, level: int) -> Codec | Literal[""]:
        """The codec of a level; empty where there is but one."""
        return self.codecs[level] if self.codecs else ""

    def level(self, bitrate_bps: float, codec: str = "") -> int | None:
        """The number of a level, or None if there is none such."""
        same = (b for b, bps in enumerate(self.bitrates_bps) if bps == bitrate_bps and self.codec(b) == codec)
        return next(same, None)

    def accuracy(self, stream: str, detector: Detector) -> tuple[float, ...]:
        """acc_d^b for a stream, one value per level."""
        return self.stream_accuracy.get((stream, detector.detector), detector.accuracy)

    def gain(self, stream: str, detector: Detector, level: int) -> float:
        """What one assignment adds to acc_obj (Eq. ilp_objective1), in 0..1.

        The bitrate is divided by the largest level. In kbps, as printed, the accuracy would outweigh the
        penalty a thousandfold and w would do nothing.
        """
        share = self.bitrates_bps[level] / self.bitrates_bps[-1]
        return share / detector.period * self.accuracy(stream, detector)[level]

    def gain_units(self, stream: str, detector: Detector, level: int) -> int:
        """``w * gain`` as a whole number of OBJECTIVE_RESOLUTION."""
        return round(self.accuracy_weight * self.gain(stream, detector, level) / OBJECTIVE_RESOLUTION)

    @property
    def penalty_units(self) -> int:
        """``1 - w``, the price of one used link, as a whole number of OBJECTIVE_RESOLUTION."""
        return round((1.0 - self.accuracy_weight) / OBJECTIVE_RESOLUTION)

    def in_time(self, stream: str, detector: Detector, level: int) -> bool:
        """Whether a frame's result keeps the deadline; always, where there is none."""
        if self.deadline is None:
            return True
        return self.result_s(stream, detector, level) <= self.deadline.limit_s + _TIME_TOLERANCE_S

    def result_s(self, stream: str, detector: Detector, level: int) -> float:
        """Seconds from capture to result: encoding, transfer, decoding, execution; needs a deadline."""
        deadline, link_bps = self.deadline, self.link(stream, detector.site)
        if deadline is None or math.isinf(link_bps):
            return detector.execution_s
        if link_bps == 0.0:
            return math.inf
        packet_bits = deadline.burst * self.bitrates_bps[level] / self.frame_rate_hz
        return deadline.encode_s + packet_bits / link_bps + deadline.decode_s + detector.execution_s


def memory_units(memory_bytes: float) -> int:
    """Finite memory as a whole number of MEMORY_RESOLUTION_BYTES."""
    return round(memory_bytes / MEMORY_RESOLUTION_BYTES)
