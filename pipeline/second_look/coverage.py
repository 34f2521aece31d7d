"""How much of the ground that was to be searched somebody looked at, and how much of it can be judged at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: an area is counted in whole cells: a smaller share than this is the edge, not a gap
EDGE_SHARE = 0.03


@dataclass(frozen=True)
class Coverage:
    """basis: the mission's search ``area``; what the drones' ``ways`` enclose; ``none`` where there is neither.

    wanted_m2: of that ground. judged_m2: of it, where the terrain is known. looked_m2: of that, seen by a camera.
    seen_m2: all ground that any camera saw, wherever it lies. mean_pod: the probability of detection of a person, mean
    over the judged ground, 0 where nobody looked, by the sensor model; None: not known. pos: the probability of success
    that the search had by the mission's prior; poa_on_map: what the prior gave to the map; None: no prior.
    """

    basis: Literal["area", "ways", "none"]
    wanted_m2: float
    judged_m2: float
    looked_m2: float
    seen_m2: float
    mean_pod: float | None = None
    pos: float | None = None
    poa_on_map: float | None = None

    @property
    def not_judged_m2(self) -> float:
        """Wanted, but off the known terrain; 0 where it is no more than the edge."""
        missing_m2 = self.wanted_m2 - self.judged_m2
        return missing_m2 if missing_m2 > EDGE_SHARE * self.wanted_m2 else 0.0

    @property
    def unseen_m2(self) -> float:
        """Judged, but nobody looked."""
        return max(self.judged_m2 - self.looked_m2, 0.0)

    @property
    def is_complete(self) -> bool:
        """Whether somebody looked at all that was wanted."""
        return self.basis != "none" and not self.not_judged_m2 and self.unseen_m2 == 0.0

    @property
    def scope(self) -> str:
        """What was searched, of how much, and how well: the denominator of the verdict."""
        if self.basis == "none":
            return f"Cameras saw {self.seen_m2:,.0f} square metres; how much was to be searched is not known."
        where = "the search area" if self.basis == "area" else "the ground that the drones flew around"
        said = f"Searched: {self.looked_m2:,.0f} of {self.wanted_m2:,.0f} square metres of {where}"
        said += f" ({min(self.looked_m2 / self.wanted_m2, 1.0):.1%})" if self.wanted_m2 > 0.0 else ""
        if self.not_judged_m2:
            said += f"; {self.not_judged_m2:,.0f} not judged"
        if self.mean_pod is not None and self.judged_m2 > 0.0:
            said += f". Of people on the ground that was judged, {self.mean_pod:.0%} would have been detected"
            said += " (POD, by the sensor model)"
        return f"{said}." if self.pos is None else f"{said}. {self.success}"

    @property
    def success(self) -> str:
        """What the search was worth by the prior; nothing without one."""
        if self.pos is None or self.poa_on_map is None:
            return ""
        return (
            f"By the prior the missing person was on this map with {self.poa_on_map:.0%}, and would have been found"
            f" with {self.pos:.0%} (probability of success)."
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is missing, a sentence each; none if nothing is."""
        if self.basis == "none":
            return (
                "Not judged: the mission states no search area, and the drones' ways enclose none, so nobody can say"
                " what was left out.",
            )
        said = []
        where = "the search area" if self.basis == "area" else "the ground that the drones flew around"
        if self.not_judged_m2:
            said.append(
                f"Not judged: {self.not_judged_m2:,.0f} of {self.wanted_m2:,.0f} square metres of {where}, which lie"
                " off the known terrain."
            )
        if self.unseen_m2:
            said.append(
                f"Nobody looked at {self.unseen_m2:,.0f} of {self.wanted_m2:,.0f} square metres of {where}."
            )
        return tuple(said)
