"""What the controller's patience is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ControllerParams:
    """Times in seconds, by the clock that ``step`` is given.

    silence_s: an actor unheard for so long is lost; what was promised is that a loss is noticed within 2 s.
    quiet_s: unheard for so long, an actor is silent together with another one of its site.
    away_s: a site whose actors fell silent together is cut off, and left alone for so long.
    rejoin_s: who is not heard so long after another one of its site is heard again is lost; a connection that retries
    seldom may take half a minute.
    boot_s: as long may an actor take from its start to its first report.
    replace_s: a silent actor, which may only be slow, is ended and started again after so long.
    restart_backoff_s, longest_backoff_s: wait before a start, doubled with every loss of the same actor.
    restarts: of one actor, at most; a source that is lost more often has ended.
    reissue_s: an order whose effect was not reported is given again after so long.
    drain_s: a substream that its source has left is closed after so long, though its end did not come.
    solve_s: an answer that has not come after so long is asked for again.
    retry_s: after the solver found nothing or broke, it is asked again so much later.
    gather_s: so long after the beginning the first plan waits for actors that are still starting.
    absence_s, step_s: after a step that came absence_s later than the one before or more, nobody is silent for that
    time, less step_s: what may pass between two steps where all is well.
    failures: of one detector on one machine; it is planned with no more after so many.
    link_worse, worse_s: a link is planned anew once it lets through less than this share of what was planned, for so
    long. link_better, better_s: and once it lets through so many times as much. link_share: of what a link was
    measured to let through, so much is planned with.
    """

    silence_s: float = 1.5
    quiet_s: float = 0.75
    away_s: float = 120.0
    rejoin_s: float = 30.0
    boot_s: float = 30.0
    replace_s: float = 2.0
    restart_backoff_s: float = 0.25
    longest_backoff_s: float = 20.0
    restarts: int = 8
    reissue_s: float = 0.5
    drain_s: float = 5.0
    solve_s: float = 4.0
    retry_s: float = 1.0
    gather_s: float = 30.0
    absence_s: float = 0.5
    step_s: float = 0.3
    failures: int = 3
    link_worse: float = 0.9
    worse_s: float = 0.4
    link_better: float = 1.25
    better_s: float = 8.0
    link_share: float = 0.9
