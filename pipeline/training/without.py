"""Networks of the same recipe that have not seen some of the groups (flights, places) of labelled pictures."""

from __future__ import annotations

from pathlib import Path

from pipeline.detection import Detector, load_detector
from pipeline.training.config import LabelledPictures, Training
from pipeline.training.export import export_trained
from pipeline.training.labelled import part
from pipeline.training.labelled_accuracy import LOWEST_SCORE
from pipeline.training.optimiser import Optimiser, Progress
from pipeline.training.pictures import PictureSet

Groups = tuple[int | str, ...]


def without(training: Training, data: LabelledPictures, learned: Groups, left_out: Groups) -> Training:
    """The same training on some groups, of which those that are left out are taken away; its name tells which."""
    own = data.model_copy(
        update={
            "train": tuple(g for g in learned if g not in left_out),
            "calibration": (),
            "folds": (),
            "test": left_out,
        }
    )
    name = f"{training.name}-without-{'-'.join(map(str, left_out))}"
    return training.model_copy(update={"name": name, "labelled": own})


def trained(training: Training, pictures: PictureSet, out: Path, progress: Progress) -> Detector:
    """The detector of a training on its part of pictures, which reports from LOWEST_SCORE on.

    Goes on from its checkpoint in out.
    """
    assert training.labelled is not None  # ``without`` gives no other
    optimiser, checkpoint, model = (
        Optimiser(training),
        out / f"{training.name}.pt",
        out / f"{training.name}.onnx",
    )
    if checkpoint.is_file():
        optimiser.resume(checkpoint)
    own = part(pictures, training.labelled, training.labelled.train)
    optimiser.run(own, checkpoint, progress, lambda: None)
    export_trained(optimiser.mean, training, model)
    return load_detector(model, score_threshold=LOWEST_SCORE)
