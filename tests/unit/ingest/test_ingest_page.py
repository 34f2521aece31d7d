"""docs/telemetry.md: its tables name every shared file, and count what is read of it rightly."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import TELEMETRY_FORMATS, read_telemetry

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs/telemetry.md").read_text(encoding="utf-8")
SHARED = ROOT.parent / "shared/data"
FOLDERS = (SHARED / "telemetry", SHARED / "cases/telemetry")


def rows() -> dict[str, tuple[str, int]]:
    """File -> the rest of its row, what of it is read; and its place among the files of the row."""
    found: dict[str, tuple[str, int]] = {}
    for line in PAGE.splitlines():
        names, _, rest = line.strip("| ").partition(" | ")
        held = re.findall(r"`([\w.-]+\.\w+)`", names) if line.startswith("| `") else []
        for place, name in enumerate(held):
            if any((folder / name).is_file() for folder in FOLDERS):
                assert name not in found, f"{name} twice"
                found[name] = rest, place
    return found


def test_every_format_has_its_place() -> None:
    for known in TELEMETRY_FORMATS:
        assert f"`{known.name}`" in PAGE, known.name


@pytest.mark.skipif(not SHARED.exists(), reason="no ../shared beside the repository")
def test_every_shared_file_is_in_a_table() -> None:
    assert sorted(rows()) == sorted(path.name for folder in FOLDERS for path in folder.iterdir())


@pytest.mark.skipif(not SHARED.exists(), reason="no ../shared beside the repository")
def test_what_the_tables_say_is_what_is_read() -> None:
    """Files that share a row have their numbers in the row's order, or one for "each"."""
    for name, (rest, place) in rows().items():
        path = next(folder / name for folder in FOLDERS if (folder / name).is_file())
        try:
            track = read_telemetry(Telemetry(file=path))
        except InputError:
            assert "refused" in rest, name
            continue
        samples = next(cell.strip() for cell in rest.split("|") if re.match(r"\s*\d", cell))
        numbers = re.findall(r"\d+", samples)
        assert int(numbers[0 if samples.endswith("each") else place]) == len(track.times_s), name
        assert all(f"{n} `{reason}`" in rest for reason, n in track.left_out.items()), (name, track.left_out)
