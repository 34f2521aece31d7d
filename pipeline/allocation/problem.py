"""The detector allocation problem: which detector looks at which frame of which stream, from where.

The paper's names (Table ilp_params): V streams, S sites, M machines, D detectors, B bitrate levels, F the
frames of one cycle. A *detector* here is one network on one machine, so the same network on two machines is
two detectors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

MemoryRule = Literal["ram", "one_detector_per_machine"]


@dataclass(frozen=True)
class Detector:
    """One network on one machine (d in D).

    id: ``MACHINE:DETECTOR``. detector: its id in the pool. period: frames from one start to the next, at
    least 1 (Eq. period). memory_bytes: ram_d. accuracy: acc_d^b in 0..1, one value per level of
    ``Problem.bitrates_bps``. execution_s: time on one frame, for pictures of the schedule; the program itself
    only sees the period.
    """

    id: str
    detector: str
    machine: str
    site: str
    period: int
    memory_bytes: float
    accuracy: tuple[float, ...]
    execution_s: float


@dataclass(frozen=True)
class MachineLimit:
    """One machine (m in M) and ram_m. Infinite memory means no limit, under either memory rule."""

    id: str
    site: str
    memory_bytes: float


@dataclass(frozen=True)
class Problem:
    """Everything that a solver reads.

    bitrates_bps: the levels b in B, finite and positive, ascending. link_bps: link_bw_v^s by (stream, site);
    a missing pair is 0 and forbids, infinity is the stream's own site. frame_rate_hz: processingFrameRate.
    detectors_per_stream, detectors_per_frame: detPerStream, detPerFrame. accuracy_weight: w in 0..1.
    memory_rule: ``ram`` is Eq. ilp_contr_ram, ``one_detector_per_machine`` is Eq. ilp_contr_ram_simpl.
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

    @cached_property
    def cycle(self) -> int:
        """cp_lcm: the frames after which every schedule repeats, the least common multiple of the periods."""
        return math.lcm(*(detector.period for detector in self.detectors))

    def link(self, stream: str, site: str) -> float:
        """link_bw_v^s, bits per second: 0 without a link, infinite at the stream's own site."""
        return self.link_bps.get((stream, site), 0.0)

    def gain(self, detector: Detector, level: int) -> float:
        """What one assignment adds to acc_obj (Eq. ilp_objective1), in 0..1.

        The bitrate is divided by the largest level. In kbps, as printed, the accuracy would outweigh the
        penalty a thousandfold and w would do nothing.
        """
        share = self.bitrates_bps[level] / self.bitrates_bps[-1]
        return share / detector.period * detector.accuracy[level]
