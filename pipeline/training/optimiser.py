"""The training loop: steps, the mean of the weights, checkpoints."""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipeline.errors import InputError
from pipeline.training.augmentation import random_crop
from pipeline.training.config import Optimisation, Training
from pipeline.training.loss import Targets, box_loss, heat_loss
from pipeline.training.network import PersonNetwork, boxes_of
from pipeline.training.pictures import PictureSet

#: called with what is being done, how much of it is done, how much there is, and a remark such as the loss
Progress = Callable[[str, int, int, str], None]
Batch = tuple[Tensor, Targets]


class Optimiser:
    """A network in training. The same training gives the same steps, interrupted or not."""

    def __init__(self, training: Training) -> None:
        torch.manual_seed(training.optimisation.seed)
        self.training = training
        self.step = 0
        self._network = PersonNetwork(training.network).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        #: the exponential mean of the network's weights
        self.mean = copy.deepcopy(self._network).eval()
        chosen = training.optimisation
        self._adam = torch.optim.AdamW(
            self._network.parameters(), chosen.learning_rate, weight_decay=chosen.weight_decay
        )

    def run(
        self, pictures: PictureSet, checkpoint: Path, progress: Progress, saved: Callable[[], None]
    ) -> None:
        """All steps that are left. saved: called after every checkpoint."""
        chosen = self.training.optimisation
        torch.set_num_threads(chosen.threads)
        with ThreadPoolExecutor(1) as ahead:

            def ask(step: int) -> Future[Batch]:
                return ahead.submit(batch_of, pictures, self.training, step)

            waiting = ask(self.step)
            while self.step < chosen.steps:
                # the next batch is made while this one is learned: a third of the time of small networks
                batch, waiting = waiting.result(), ask(self.step + 1)
                heat, box = self.take_step(batch)
                if not math.isfinite(heat + box):
                    raise InputError(
                        checkpoint, f"a loss of {heat + box} at step {self.step}", "a smaller learning rate"
                    )
                progress("training", self.step, chosen.steps, f"heat {heat:.3f} box {box:.3f}")
                if self.step % chosen.save_every == 0 or self.step == chosen.steps:
                    self.save(checkpoint)
                    saved()

    def take_step(self, batch: Batch) -> tuple[float, float]:
        """One step on the batch of this step: the losses of the heat and of the boxes before it."""
        images, targets = batch
        for group in self._adam.param_groups:
            group["lr"] = learning_rate(self.step, self.training.optimisation)
        self._network.train()
        with torch.autocast("cpu", torch.bfloat16, enabled=self.training.optimisation.half_precision):
            features = self._network.features(images)
        logits, distances = self._network.readings(features.float())
        heat, box = heat_loss(logits, targets), box_loss(boxes_of(distances, self._network.stride), targets)
        self._adam.zero_grad(set_to_none=True)
        (heat + box).backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self._network.parameters(), 10.0)
        self._adam.step()
        self.step += 1
        self._average()
        return float(heat.detach()), float(box.detach())

    def save(self, path: Path) -> None:
        """Everything that is needed to go on; the file is replaced at once."""
        state = {
            "training": self._told(),
            "step": self.step,
            "network": self._network.state_dict(),
            "mean": self.mean.state_dict(),
            "adam": self._adam.state_dict(),
        }
        partial = path.with_suffix(".part")
        torch.save(state, partial)
        os.replace(partial, path)

    def resume(self, path: Path) -> None:
        """Go on where a checkpoint was saved. Raises InputError if it is of another training."""
        state: dict[str, Any] = torch.load(path, weights_only=True)
        if state["training"] != self._told():
            raise InputError(
                path, "the checkpoint of another configuration", "an empty output folder or the same one"
            )
        self.step = state["step"]
        self._network.load_state_dict(state["network"])
        self.mean.load_state_dict(state["mean"])
        self._adam.load_state_dict(state["adam"])

    def _told(self) -> str:
        # without defaults: a key that comes later, and is not used, makes no other training of an old one
        return self.training.model_dump_json(exclude_defaults=True)

    def start_from(self, path: Path) -> None:
        """Begin with the mean weights of another training's checkpoint, as far as the networks are alike.

        Raises InputError if they are not alike at all.
        """
        if not path.is_file():
            raise InputError(
                path, "no checkpoint", f"the finished training {self.training.start!r} beside this one"
            )
        given = torch.load(path, weights_only=True)["mean"]
        own = self._network.state_dict()
        shared = {name: given[name] for name in own if name in given and given[name].shape == own[name].shape}
        if not shared:
            raise InputError(path, "another network", f"one with the channels of {self.training.name!r}")
        for network in (self._network, self.mean):
            network.load_state_dict(shared, strict=False)

    @torch.no_grad()
    def _average(self) -> None:
        # the first steps would otherwise weigh for long
        decay = min(self.training.optimisation.ema_decay, (1 + self.step) / (10 + self.step))
        for mean, now in zip(
            self.mean.state_dict().values(), self._network.state_dict().values(), strict=True
        ):
            if mean.is_floating_point():
                mean.lerp_(now, 1.0 - decay)
            else:
                mean.copy_(now)


def batch_of(pictures: PictureSet, training: Training, step: int) -> Batch:
    """Images (B, 3, crop, crop) in 0..1 and their targets; they depend on the seed and the step alone."""
    rng = np.random.default_rng([training.optimisation.seed, step])
    params = training.augmentation
    crops = [
        random_crop(pictures, training.input.width, params, rng) for _ in range(training.optimisation.batch)
    ]
    images = torch.from_numpy(np.stack([crop.image for crop in crops])).permute(0, 3, 1, 2)
    targets = Targets.of(
        [crop.people for crop in crops],
        [crop.ignored for crop in crops],
        params.crop,
        params.crop,
        training.network.stride,
    )
    # permuted from (B, H, W, 3): already in torch's channels-last order
    return images.to(torch.float32) / 255.0, targets


def learning_rate(step: int, chosen: Optimisation) -> float:
    """Linear warm-up, then per cycle a cosine down to a hundredth of its own rate."""
    length = math.ceil(chosen.steps / chosen.cycles)
    cycle, within = divmod(step, length)
    warmup = chosen.warmup_steps if cycle == 0 else 0
    rate = chosen.learning_rate * 0.5**cycle
    if within < warmup:
        return rate * (within + 1) / warmup
    share = (within - warmup) / max(length - warmup, 1)
    return rate * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * share)))
