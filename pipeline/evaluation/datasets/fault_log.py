"""What is wrong with a data set or a detector: counted and named, and refused or left out as configured."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from pipeline.config.evaluation import FaultKind, FaultPolicy
from pipeline.errors import InputError

#: what is done about a fault of the kind where it is not refused
LEFT_OUT: dict[FaultKind, str] = {
    "missing_image": "annotations or pictures left out",
    "outside_box": "boxes cut to the picture, or left out where nothing is left",
    "duplicate_id": "all but the first left out",
    "unknown_category": "boxes left out",
    "frame_count": "pictures beyond the video left out",
    "not_finite": "detections left out",
}
_EXAMPLES = 3


@dataclass
class FaultLog:
    """Faults met so far: how many of each kind, and the first few of them in words."""

    policy: FaultPolicy
    counts: Counter[FaultKind] = field(default_factory=Counter)
    examples: dict[FaultKind, list[str]] = field(default_factory=dict)

    def report(self, kind: FaultKind, where: object, found: str, expected: str, count: int = 1) -> None:
        """Raises InputError if the policy refuses the kind; otherwise counts it."""
        error = InputError(where, found, expected)
        if getattr(self.policy, kind) == "refuse":
            raise error
        self.counts[kind] += count
        examples = self.examples.setdefault(kind, [])
        if len(examples) < _EXAMPLES:
            examples.append(str(error))

    def lines(self) -> list[str]:
        """One line for each kind that was met."""
        return [
            f"{kind}: {count} ({LEFT_OUT[kind]}), e.g. {self.examples[kind][0]}"
            for kind, count in sorted(self.counts.items())
        ]
