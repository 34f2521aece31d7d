"""Whatever happened to a video file, it is read as far as it goes or refused in one line, and soon."""

import random
from collections import Counter
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.ingest.source import LostPicture, PassedPicture, Picture
from pipeline.ingest.video.recordings import open_recordings
from tests.mutations import Longest, mutated
from tests.videos import busy, plain, write_video

FEW, MANY = 40, 700
SUFFIXES = ("mp4", "mkv", "ts")
MOST_S = 2.0


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[bytes]]:
    """A video with large packets, one that is mostly heads, and one whose heads come first, of each container."""
    folder = tmp_path_factory.mktemp("whole")
    return {
        suffix: [
            write_video(
                folder / f"{number}.{suffix}", count=20, picture=picture, container_options=options
            ).read_bytes()
            for number, (picture, options) in enumerate(
                [(busy, {}), (plain, {}), (plain, {"movflags": "faststart"} if suffix == "mp4" else {})]
            )
        ]
        for suffix in SUFFIXES
    }


def try_to_use(path: Path) -> str:
    """What became of it: refused, or used. Anything but InputError is let out."""
    refusal = ""
    try:
        source = open_recordings([path])
        pictures = list(source.pictures(10.0))
        list(source.images_at([p.time_s for p in pictures[:2]]))
    except InputError as error:
        refusal = str(error)
    if refusal:
        assert "\n" not in refusal
        return "refused"
    assert source.end_s < 14 * 3600 * len(pictures)
    assert all(isinstance(p, Picture | LostPicture | PassedPicture) for p in pictures)
    assert [p.index for p in pictures] == list(range(len(pictures)))
    return "used"


def go_through(originals: dict[str, list[bytes]], suffix: str, count: int, path: Path) -> None:
    fates, longest = Counter[str](), Longest(MOST_S)
    for seed in range(count):
        chance = random.Random(f"{suffix}{seed}")
        path.write_bytes(mutated(originals[suffix][seed % 3], chance))
        with longest.of(f"seed {seed}"):
            fates[try_to_use(path)] += 1
    print(suffix, dict(fates), f"longest {longest.seconds:.2f} s")
    assert set(fates) == {"used", "refused"} or suffix == "ts"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_few_mutated_videos(originals: dict[str, list[bytes]], suffix: str, tmp_path: Path) -> None:
    go_through(originals, suffix, FEW, tmp_path / f"mutated.{suffix}")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_many_mutated_videos(originals: dict[str, list[bytes]], suffix: str, tmp_path: Path) -> None:
    go_through(originals, suffix, MANY, tmp_path / f"mutated.{suffix}")
