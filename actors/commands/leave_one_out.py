"""``searchlight train --leave-one-out``: what a training finds in each flight that it has not seen."""

from __future__ import annotations

from pathlib import Path

from actors.terminal import progress_bars, say
from pipeline.training.leave_one_out import Fold, leave_one_out


def print_folds(config: Path, out: Path, steps: int | None) -> None:
    """A line for each group that was left out. Raises InputError."""

    def line(fold: Fold) -> None:
        r = fold.result
        shown = ["none" if r[k] is None else f"{r[k]:.3f}" for k in ("ap50", "ap")]
        say(
            f"without {fold.left_out}: AP .5 {shown[0]}, AP .5:.95 {shown[1]} "
            f"({r['people']} people in {r['pictures']} pictures)"
        )

    with progress_bars("steps") as progress:
        folds = leave_one_out(config, out, steps=steps, progress=progress, finished=line)
    known = [f.result["ap50"] for f in folds if f.result["ap50"] is not None]
    if known:
        say(f"mean AP .5 {sum(known) / len(known):.3f}, least {min(known):.3f}")
