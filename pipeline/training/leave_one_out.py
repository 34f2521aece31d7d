"""How well a training carries over to a flight (or place) that it has not seen, for each of them in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.detection import load_detector
from pipeline.errors import InputError
from pipeline.training.config import LabelledPictures, Training, load_training
from pipeline.training.export import export_onnx
from pipeline.training.labelled import part, prepare_labelled
from pipeline.training.labelled_accuracy import LOWEST_SCORE, accuracy, look
from pipeline.training.optimiser import Optimiser, Progress
from pipeline.training.pictures import PictureSet


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
        fold = _without(training, given, group, steps)
        folds.append(Fold(group, _measured(fold, given, pictures, group, out, progress)))
        finished(folds[-1])
    return folds


def _without(training: Training, given: LabelledPictures, group: int | str, steps: int | None) -> Training:
    others = tuple(g for g in given.groups if g != group)
    own = given.model_copy(update={"train": others, "calibration": (), "test": (group,)})
    full = training.optimisation
    # a shorter schedule still has to learn for most of its length
    changed = {} if steps is None else {"steps": steps, "warmup_steps": min(full.warmup_steps, steps // 10)}
    return training.model_copy(
        update={
            "name": f"{training.name}-without-{group}",
            "labelled": own,
            "optimisation": full.model_copy(update=changed),
        }
    )


def _measured(
    fold: Training,
    given: LabelledPictures,
    pictures: PictureSet,
    group: int | str,
    out: Path,
    progress: Progress,
) -> dict[str, Any]:
    assert fold.labelled is not None
    optimiser, checkpoint, model = Optimiser(fold), out / f"{fold.name}.pt", out / f"{fold.name}.onnx"
    if checkpoint.is_file():
        optimiser.resume(checkpoint)
    optimiser.run(part(pictures, given, fold.labelled.train), checkpoint, progress, lambda: None)
    export_onnx(
        optimiser.mean,
        model,
        width=fold.input.width,
        height=fold.input.height,
        name=fold.name,
        trained_on=fold.trained_on,
    )
    left_out = part(pictures, given, (group,))
    looked = look(load_detector(model, score_threshold=LOWEST_SCORE), left_out, left_out.clean)
    return accuracy(looked, LOWEST_SCORE)
