"""What a link is planned with: slow to believe that it is better, quick to believe that it is worse."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from pipeline.mission.controller.params import ControllerParams


@dataclass(frozen=True)
class LinkState:
    """The radio link of one stream to one site, bit/s.

    planned_bps: what a plan may use. worse_since_s, better_since_s: since when the measurement says otherwise.
    """

    declared_bps: float
    planned_bps: float
    worse_since_s: float = math.inf
    better_since_s: float = math.inf


def declared(bandwidth_bps: float) -> LinkState:
    """A link that nobody has measured."""
    return LinkState(bandwidth_bps, bandwidth_bps)


def measured(link: LinkState, rate_bps: float, now: float, params: ControllerParams) -> LinkState:
    """The link after one measurement; never planned with more than was declared."""
    usable_bps = min(link.declared_bps, rate_bps * params.link_share)
    if rate_bps < params.link_worse * link.planned_bps:
        since_s = min(link.worse_since_s, now)
        if now - since_s < params.worse_s:
            return replace(link, worse_since_s=since_s, better_since_s=math.inf)
        return LinkState(link.declared_bps, usable_bps)
    if _may_be_raised(link, usable_bps, params):
        since_s = min(link.better_since_s, now)
        if now - since_s < params.better_s:
            return replace(link, better_since_s=since_s, worse_since_s=math.inf)
        return LinkState(link.declared_bps, usable_bps)
    return replace(link, worse_since_s=math.inf, better_since_s=math.inf)


def _may_be_raised(link: LinkState, usable_bps: float, params: ControllerParams) -> bool:
    at_the_top = usable_bps == link.declared_bps and link.planned_bps < link.declared_bps
    return at_the_top or usable_bps > params.link_better * link.planned_bps
