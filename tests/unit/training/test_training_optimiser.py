"""A few steps on squares: it learns, it repeats, it goes on after an interruption."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra [train] is not installed")

from pipeline.errors import InputError  # noqa: E402
from pipeline.training.config import load_training  # noqa: E402
from pipeline.training.optimiser import Optimiser, batch_of, learning_rate  # noqa: E402
from pipeline.training.pictures import PictureSet  # noqa: E402

CONFIGS = Path(__file__).parents[3] / "configs" / "detectors"
FAMILY = ("nano", "small", "medium", "large", "thermal-nano", "thermal-small")


@pytest.fixture(scope="module")
def squares() -> PictureSet:
    """Red squares on grey noise."""
    rng = np.random.default_rng(0)
    images = rng.integers(80, 140, (8, 144, 256, 3), dtype=np.uint8)
    boxes = []
    for image in images:
        x, y = rng.integers(0, 200), rng.integers(0, 100)
        image[y : y + 36, x : x + 24] = [230, 30, 30]
        boxes.append(np.array([[x, y, x + 24, y + 36]], float))
    return PictureSet(images, images, boxes, [np.ones(1)] * 8)


@pytest.fixture
def toy():
    training = load_training(CONFIGS / "nano.train.yaml")
    return training.model_copy(
        update={
            "input": training.input.model_copy(update={"width": 256, "height": 144}),
            "network": training.network.model_copy(
                update={"channels": (4, 8, 8, 16), "blocks": (0, 1), "head": 8}
            ),
            "augmentation": training.augmentation.model_copy(update={"crop": 96}),
            "optimisation": training.optimisation.model_copy(
                update={
                    "steps": 40,
                    "batch": 4,
                    "warmup_steps": 5,
                    "save_every": 20,
                    "learning_rate": 0.01,
                    "half_precision": False,
                }
            ),
        }
    )


def test_each_cycle_ends_low_and_starts_at_half_the_rate_of_the_one_before(toy):
    chosen = toy.optimisation.model_copy(update={"steps": 40, "cycles": 2, "warmup_steps": 5})
    rates = [learning_rate(step, chosen) for step in range(40)]
    peak = chosen.learning_rate
    np.testing.assert_allclose([rates[0], rates[5], rates[20]], [peak / 5, peak, peak / 2])
    assert max(rates[19], rates[39]) < 0.03 * peak
    assert (np.diff(rates[5:20]) < 0).all()
    assert (np.diff(rates[20:]) < 0).all()


def silent(*_):
    pass


def step_on(optimiser: Optimiser, pictures: PictureSet) -> float:
    return sum(optimiser.take_step(batch_of(pictures, optimiser.training, optimiser.step)))


def test_the_loss_falls(squares, toy):
    optimiser = Optimiser(toy)
    losses = [step_on(optimiser, squares) for _ in range(40)]
    assert np.mean(losses[-5:]) < 0.6 * np.mean(losses[:5])


def test_an_interrupted_training_ends_with_the_same_weights(squares, toy, tmp_path):
    straight = Optimiser(toy)
    straight.run(squares, tmp_path / "straight.pt", silent, silent)
    first = Optimiser(toy)
    while first.step < 17:
        step_on(first, squares)
    first.save(tmp_path / "stopped.pt")
    second = Optimiser(toy)
    second.resume(tmp_path / "stopped.pt")
    second.run(squares, tmp_path / "stopped.pt", silent, silent)
    for a, b in zip(straight.mean.state_dict().values(), second.mean.state_dict().values(), strict=True):
        assert torch.equal(a, b)


def test_a_checkpoint_of_another_training_is_refused(toy, tmp_path):
    Optimiser(toy).save(tmp_path / "toy.pt")
    other = Optimiser(toy.model_copy(update={"name": "other"}))
    with pytest.raises(InputError, match=r"toy\.pt.*another configuration"):
        other.resume(tmp_path / "toy.pt")


def test_a_training_begins_with_what_another_one_learned(squares, toy, tmp_path):
    taught = Optimiser(toy)
    taught.run(squares, tmp_path / "toy.pt", silent, silent)
    deeper = toy.network.model_copy(update={"blocks": (0, 2)})
    pupil = Optimiser(toy.model_copy(update={"network": deeper}))
    pupil.start_from(tmp_path / "toy.pt")
    picture = torch.rand(1, 3, 96, 96)
    for known, new in zip(taught.mean(picture), pupil.mean(picture), strict=True):
        torch.testing.assert_close(new, known)


def test_a_training_that_begins_with_a_missing_one_is_refused(toy, tmp_path):
    with pytest.raises(InputError, match=r"medium\.pt.*no checkpoint.*'medium'"):
        Optimiser(toy.model_copy(update={"start": "medium"})).start_from(tmp_path / "medium.pt")


def test_half_precision_learns_as_well(squares, toy):
    half = toy.optimisation.model_copy(update={"half_precision": True})
    optimiser = Optimiser(toy.model_copy(update={"optimisation": half}))
    losses = [step_on(optimiser, squares) for _ in range(40)]
    assert np.mean(losses[-5:]) < 0.6 * np.mean(losses[:5])


@pytest.mark.parametrize("name", FAMILY)
def test_the_shipped_training_files_are_valid(name):
    training = load_training(CONFIGS / f"{name}.train.yaml")
    assert training.name == name
    assert training.augmentation.crop <= training.input.height


def test_an_unknown_key_in_a_training_file_is_named(tmp_path):
    path = tmp_path / "bad.train.yaml"
    path.write_text((CONFIGS / "nano.train.yaml").read_text() + "colour: red\n")
    with pytest.raises(InputError, match=r"bad\.train\.yaml:\d+ colour"):
        load_training(path)
