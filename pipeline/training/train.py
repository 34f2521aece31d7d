"""``searchlight train``: from a training file to a detector and its card."""

from __future__ import annotations

import datetime
from pathlib import Path

from pipeline.detection import load_detector
from pipeline.simulation.dataset import MISSION_VIEWS, SIZE_VIEWS, TRAINING_VIEWS
from pipeline.training.card import write_card
from pipeline.training.config import Data, LabelledPictures, Scenes, Training, load_training
from pipeline.training.export import export_trained
from pipeline.training.labelled import part, prepare_labelled
from pipeline.training.labelled_accuracy import LOWEST_SCORE, Looked, look, together
from pipeline.training.labelled_card import write_labelled_card
from pipeline.training.optimiser import Optimiser, Progress
from pipeline.training.pictures import PictureSet, is_complete, open_pictures, render_pictures, shots
from pipeline.training.without import trained, without


def train(
    config_path: Path, out: Path, *, progress: Progress, data: Path | None = None, workers: int = 2
) -> Path:
    """Train the detector of a training file; returns NAME.onnx in out, with NAME.card.yaml beside it.

    Goes on from NAME.pt in out if it is there. data: where the pictures are kept, ``out / "data"`` if not
    given; pictures that are there are used again. workers: processes that render. Raises InputError for a bad
    training file, labels or pictures, or a checkpoint or pictures of another one.
    """
    training = load_training(config_path)
    out.mkdir(parents=True, exist_ok=True)
    pictures = prepare(training, config_path.parent, data or out / "data", workers, progress)
    optimiser = Optimiser(training)
    checkpoint, model = out / f"{training.name}.pt", out / f"{training.name}.onnx"
    if checkpoint.is_file():
        optimiser.resume(checkpoint)
    elif training.start:
        optimiser.start_from(out / f"{training.start}.pt")
    optimiser.run(
        pictures["train"], checkpoint, progress, lambda: export_trained(optimiser.mean, training, model)
    )
    export_trained(optimiser.mean, training, model)
    today = datetime.date.today()
    if training.labelled is None:
        write_card(training, model, pictures["mission"], pictures["sizes"], today)
    else:
        unseen = _unseen(training, training.labelled, model, pictures, out, progress)
        write_labelled_card(training, model, unseen, pictures["test"], today)
    return model


def prepare(
    training: Training, base: Path, folder: Path, workers: int, progress: Progress
) -> dict[str, PictureSet]:
    """The pictures of each part of the data by name, rendered or copied if they are not there yet.

    base: the training file's folder.
    """
    given = training.labelled
    if given is not None:
        pictures = prepare_labelled(
            given, base, folder, lambda done, total: progress("copying", done, total, "")
        )
        parts = {"train": given.train, "calibration": given.calibration, "test": given.test}
        return {name: part(pictures, given, groups) for name, groups in parts.items()}
    assert training.data is not None  # one of both is there
    return _rendered(training.data, folder, workers, progress)


def _rendered(data: Data, folder: Path, workers: int, progress: Progress) -> dict[str, PictureSet]:
    plans = {
        "train": shots(*_of(data.train), "train", TRAINING_VIEWS),
        "mission": shots(*_of(data.mission), "mission", MISSION_VIEWS),
        "sizes": shots(*_of(data.sizes), "mission", SIZE_VIEWS),
    }
    for name, plan in plans.items():
        if not is_complete(folder / name):
            render_pictures(
                folder / name, plan, workers, lambda done, total: progress("rendering", done, total, "")
            )
    return {name: open_pictures(folder / name, plan) for name, plan in plans.items()}


def _unseen(
    training: Training,
    data: LabelledPictures,
    model: Path,
    pictures: dict[str, PictureSet],
    out: Path,
    progress: Progress,
) -> Looked:
    """What the model found in pictures that it had not learned from, or, of folds, networks of its recipe."""
    if data.calibration:
        own = pictures["calibration"]
        return look(load_detector(model, score_threshold=LOWEST_SCORE), own, own.clean)
    looks = []
    for groups in data.folds:
        detector = trained(without(training, data, data.train, groups), pictures["train"], out, progress)
        left_out = part(pictures["train"], data, groups)
        looks.append(look(detector, left_out, left_out.clean))
    return together(looks)


def _of(scenes: Scenes) -> tuple[int, int, int]:
    return scenes.seed, scenes.scenes, scenes.pictures
