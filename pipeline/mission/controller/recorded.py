"""The log of a mission's events: played again it gives the same state and the same orders."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from pipeline.mission.controller.controller import step
from pipeline.mission.controller.events import Event
from pipeline.mission.controller.orders import Order
from pipeline.mission.controller.state import MissionState


@dataclass(frozen=True)
class Recorded:
    """One event, when it was taken (seconds, as given to ``step``), and what was ordered."""

    at_s: float
    event: Event
    orders: tuple[Order, ...]


def replay(state: MissionState, log: Iterable[Recorded]) -> MissionState:
    """The state after a log. Raises ValueError if ``step`` orders something else today than is recorded."""
    for number, recorded in enumerate(log):
        state, orders = step(state, recorded.event, recorded.at_s)
        if tuple(orders) != recorded.orders:
            raise ValueError(
                f"event {number} at {recorded.at_s:.3f} s, {type(recorded.event).__name__}: "
                f"the log has the orders {recorded.orders}, now they would be {tuple(orders)}"
            )
    return state
