"""What a check noticed, with its evidence and what would mend it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: error: the mission does not run. warning: it runs, and the report repeats it. assumed: nothing said otherwise.
Severity = Literal["error", "warning", "assumed"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One line for the user.

    cause: a word that names the kind, e.g. ``height_off``; what the data cannot tell apart is named with
    slashes, ``height_off/focal_length``. where: file, stream or field. found: in words, with the value.
    evidence: the measurement behind it. mend: what to write in the mission file, or to do; never done unasked.
    """

    severity: Severity
    cause: str
    where: str
    found: str
    evidence: str = ""
    mend: str = ""

    def __str__(self) -> str:
        parts = [f"{self.severity}: {self.where}: {self.found}"]
        parts += [f"evidence: {self.evidence}"] if self.evidence else []
        parts += [f"to mend: {self.mend}"] if self.mend else []
        return "; ".join(parts)
