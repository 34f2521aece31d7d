"""How well a training carries over to a flight (or place) that it has not seen, for each of them in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.training.config import Training, load_training
from pipeline.training.labelled import part, prepare_labelled
from pipeline.training.labelled_accuracy import LOWEST_SCORE, accuracy, look
from pipeline.training.optimiser import Progress
from pipeline.training.without import trained, without


@dataclass(frozen=True, slots=True)
class Fold:
    """left_out: the group that was only measured on. result: of its pictures, see labelled_accuracy.accuracy."""

    left_out: int | str
    result: dict[str, Any]


def leave_one_out(
    config_path: Path,
    out: Path,
    *,
    steps: int | None,
    progress: Progress,
    finished: Callable[[Fold], None],
) -> list[Fold]:
    """Train once for each group of a training file's pictures, on all others; the schedule may be shorter.

    steps: of each training; None: as many as the training file says. Goes on from what is in out, whose
    ``data`` may be that of ``train``. finished: called with each fold. Raises InputError as ``train`` does, and
    for a training on simulated pictures.
    """
    training = load_training(config_path)
    given = training.labelled
    if given is None:
        raise InputError(f"{config_path} labelled", "simulated pictures", "labelled pictures to split")
    out.mkdir(parents=True, exist_ok=True)
    pictures = prepare_labelled(
        given, config_path.parent, out / "data", lambda done, total: progress("copying", done, total, "")
    )
    folds = []
    for group in sorted(given.groups, key=str):
        fold = without(_shorter(training, steps), given, given.groups, (group,))
        detector = trained(fold, pictures, out, progress)
        left_out = part(pictures, given, (group,))
        folds.append(Fold(group, accuracy(look(detector, left_out, left_out.clean), LOWEST_SCORE)))
        finished(folds[-1])
    return folds


def _shorter(training: Training, steps: int | None) -> Training:
    if steps is None:
        return training
    full = training.optimisation
    # a shorter schedule still has to learn for most of its length
    changed = {"steps": steps, "warmup_steps": min(full.warmup_steps, steps // 10)}
    return training.model_copy(update={"optimisation": full.model_copy(update=changed)})
