"""Small allocation problems, and the instance behind the paper's Table ilp_eval1."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pipeline.allocation.problem import Detector, MachineLimit, Problem

GB = 1e9
PAPER_LEVELS_KBPS = (50, 75, 100, 250, 500, 1000, 2500, 5000, 20000)

#: periods of the networks by machine type, at detPerStream 5: notes on the paper, number 2
PAPER_PERIODS = {
    "a": {},
    "b": {"ssd_i": 1, "ssd_m": 1, "ssd_m_cpu": 2, "r50": 4, "rfcn": 4, "ssd_r50": 4, "r101": 5},
    "c": {"ssd_i": 1, "ssd_m": 1, "ssd_m_cpu": 2, "r50": 2, "ssd_r50": 2, "r101": 3, "rfcn": 3},
    "d": {"ssd_i": 2, "ssd_m": 2, "ssd_m_cpu": 2, "r50": 2, "ssd_r50": 2, "r101": 3, "rfcn": 3},
}
PAPER_GB = {"ssd_i": 2, "ssd_m": 2, "ssd_m_cpu": 2, "r50": 3, "ssd_r50": 3, "r101": 4, "rfcn": 4}
PAPER_ACCURACY = {
    "ssd_i": 0.45,
    "ssd_m": 0.40,
    "ssd_m_cpu": 0.40,
    "r50": 0.86,
    "ssd_r50": 0.82,
    "r101": 0.9,
    "rfcn": 0.88,
}
PAPER_MACHINE_GB = {"a": 16, "b": 8, "c": 12, "d": 16}


@pytest.fixture
def tiny() -> Callable[..., Problem]:
    """One stream ``v``, one machine ``m`` at one site ``s``; a detector is (name, period, accuracy, GB)."""

    def build(
        *detectors: tuple[str, int, float, float],
        machine_gb: float = 10.0,
        link_mbps: float = 10.0,
        **rest: object,
    ) -> Problem:
        fields: dict[str, object] = {
            "streams": ("v",),
            "sites": ("s",),
            "machines": (MachineLimit("m", "s", machine_gb * GB),),
            "detectors": tuple(
                Detector(f"m:{name}", name, "m", "s", period, gb * GB, (accuracy / 2, accuracy), period / 10)
                for name, period, accuracy, gb in detectors
            ),
            "bitrates_bps": (1e6, 4e6),
            "link_bps": {("v", "s"): link_mbps * 1e6},
            "frame_rate_hz": 10.0,
            "detectors_per_stream": 2,
            "detectors_per_frame": 2,
            "accuracy_weight": 0.6,
        }
        return Problem(**{**fields, **rest})  # type: ignore[arg-type]

    return build


@pytest.fixture
def paper_instance() -> Callable[[int, int, int], Problem]:
    """(detectors per stream, streams, bitrate levels) -> the paper's 40 machines, 10 at each of 4 sites."""

    def build(detectors_per_stream: int, streams: int, levels: int) -> Problem:
        names = tuple(f"v{i}" for i in range(streams))
        link = 20e6 if levels == len(PAPER_LEVELS_KBPS) else 1e6
        copies = [(kind, f"{kind}{i}") for kind in "abcd" for i in range(10)]
        return Problem(
            streams=names,
            sites=tuple("abcd"),
            machines=tuple(MachineLimit(m, kind, PAPER_MACHINE_GB[kind] * GB) for kind, m in copies),
            detectors=tuple(
                Detector(
                    f"{m}:{net}",
                    net,
                    m,
                    kind,
                    period,
                    PAPER_GB[net] * GB,
                    tuple(PAPER_ACCURACY[net] * (0.5 + 0.5 * b / (levels - 1)) for b in range(levels)),
                    period / 30.0,
                )
                for kind, m in copies
                for net, period in PAPER_PERIODS[kind].items()
                if period <= detectors_per_stream
            ),
            bitrates_bps=tuple(kbps * 1e3 for kbps in PAPER_LEVELS_KBPS[:levels]),
            link_bps={(v, s): link for v in names for s in "abcd"},
            frame_rate_hz=30.0,
            detectors_per_stream=detectors_per_stream,
            detectors_per_frame=2,
            accuracy_weight=0.6,
        )

    return build
