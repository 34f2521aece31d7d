"""The pictures to learn from, on disk: clean, the same after a lossy codec, and the people in them."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.messages import FloatArray
from pipeline.simulation.dataset import CAMERA, Views, pictures_of_scene
from pipeline.training.degradation import degrade

Image = NDArray[np.uint8]
#: the recording and the link both compress a mission's pictures: they are as worn as ours at 0.3 to 1 Mbps
BITRATES_BPS = (0.1e6, 2.5e6)


@dataclass(frozen=True, slots=True)
class SceneShots:
    """count pictures of one scene, which are number first, first + 1, .. of the set."""

    seed: int
    split: Literal["train", "mission"]
    views: Views
    first: int
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class PictureSet:
    """clean, degraded: uint8 (N, H, W, 3), on disk. boxes_px (.., 4) xyxy, visible_shares: per picture.

    attributes: of labelled pictures what the labels say of each beside its boxes; of rendered ones nothing.
    rows: int64, numbers of those that belong to this set; None: all of them.
    """

    clean: Image
    degraded: Image
    boxes_px: list[FloatArray]
    visible_shares: list[FloatArray]
    attributes: tuple[dict[str, Any], ...] = ()
    rows: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Numbers of the pictures of this set in its files and lists."""
        return np.arange(len(self.boxes_px)) if self.rows is None else self.rows


def shots(
    first_seed: int, scenes: int, pictures: int, split: Literal["train", "mission"], views: Views
) -> list[SceneShots]:
    """pictures spread evenly over scenes with the seeds first_seed, first_seed + 1, .."""
    edges = [pictures * i // scenes for i in range(scenes + 1)]
    return [
        SceneShots(first_seed + i, split, views, edges[i], edges[i + 1] - edges[i]) for i in range(scenes)
    ]


def render_pictures(
    folder: Path, plan: list[SceneShots], workers: int, rendered: Callable[[int, int], None]
) -> None:
    """Write the pictures of a plan. rendered: called with how many pictures are done and how many there are.

    ``people.json`` is written last: a folder that has it is complete.
    """
    total = sum(s.count for s in plan)
    picture_files(folder, (total, CAMERA.height, CAMERA.width, 3))
    people: list[Any] = [None] * total
    done = 0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool:
        jobs = {pool.submit(_render_scene, folder, s): s for s in plan}
        for job in as_completed(jobs):
            s = jobs[job]
            people[s.first : s.first + s.count] = job.result()
            done += s.count
            rendered(done, total)
    record = {"plan": _json(plan), "people": people}
    (folder / "people.json").write_text(json.dumps(record), encoding="utf-8")


def picture_files(folder: Path, shape: tuple[int, int, int, int]) -> tuple[Image, Image]:
    """New files for the clean and the degraded pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    clean, degraded = (
        np.lib.format.open_memmap(folder / f"{name}.npy", mode="w+", dtype=np.uint8, shape=shape)
        for name in ("clean", "degraded")
    )
    return clean, degraded


def _render_scene(folder: Path, plan: SceneShots) -> list[dict[str, Any]]:
    clean, degraded = (np.load(folder / f"{name}.npy", mmap_mode="r+") for name in ("clean", "degraded"))
    rng = np.random.default_rng([plan.seed, 2])
    people = []
    for i, picture in enumerate(pictures_of_scene(plan.seed, plan.split, plan.count, plan.views), plan.first):
        bitrate_bps = float(np.exp(rng.uniform(*np.log(BITRATES_BPS))))
        clean[i], degraded[i] = picture.image, degrade(picture.image, bitrate_bps, rng)
        people.append({"boxes": picture.boxes_px.tolist(), "visible": picture.visible_shares.tolist()})
    return people


def is_complete(folder: Path) -> bool:
    """Whether render_pictures has finished there."""
    return (folder / "people.json").is_file()


def open_pictures(folder: Path, plan: list[SceneShots]) -> PictureSet:
    """What render_pictures wrote. Raises InputError if it did not finish there, or followed another plan."""
    return open_recorded(folder, _json(plan))


def open_recorded(folder: Path, plan: Any) -> PictureSet:
    """A written picture set. plan: what it must have been made of, as JSON. Raises InputError."""
    if not is_complete(folder):
        raise InputError(folder, "no complete picture set", "a folder written by searchlight train")
    record: dict[str, Any] = json.loads((folder / "people.json").read_text(encoding="utf-8"))
    if record["plan"] != plan:
        raise InputError(folder, "other pictures", "those of this training file, or an empty folder")
    return PictureSet(
        np.load(folder / "clean.npy", mmap_mode="r"),
        np.load(folder / "degraded.npy", mmap_mode="r"),
        [np.array(entry["boxes"], float).reshape(-1, 4) for entry in record["people"]],
        [np.array(entry["visible"], float) for entry in record["people"]],
        tuple(entry.get("attributes", {}) for entry in record["people"]),
    )


def _json(plan: list[SceneShots]) -> Any:
    return json.loads(json.dumps([asdict(s) for s in plan]))
