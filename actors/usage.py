"""What a process uses of its node: memory, processor; and what its clock says."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def resident_bytes(process: str = "self") -> int:
    """Of a process, by its number. Raises OSError for one that is gone."""
    return int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]) * _PAGE_BYTES


@dataclass(frozen=True)
class Usage:
    """Of the process that makes it, at that moment. memory_bytes: resident. cpu_s: seconds of processor since it
    began. utc_s: its node's clock, seconds since 1970.
    """

    memory_bytes: int = field(default_factory=resident_bytes)
    cpu_s: float = field(default_factory=time.process_time)
    utc_s: float = field(default_factory=time.time)
