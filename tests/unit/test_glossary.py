"""The glossary speaks of things that exist, and of each word once."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GLOSSARY = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")


def test_the_files_and_records_that_it_names_exist() -> None:
    named = re.findall(r"`([A-Za-z_./]+)`", GLOSSARY)
    files = [name for name in named if "/" in name]
    assert files
    assert [name for name in files if not (ROOT / name).exists()] == []
    records = [name for name in named if re.fullmatch(r"[A-Z][a-z]+(?:[A-Z][a-z]+)*", name)]
    code = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "pipeline").rglob("*.py"))
    assert "SalientLocation" in records
    assert [name for name in records if f"class {name}" not in code] == []


def test_every_word_has_one_meaning() -> None:
    rows = [line for line in GLOSSARY.splitlines() if line.startswith("| *")]
    words = [word for row in rows for word in re.findall(r"\*([^*]+)\*", row.split("|")[1])]
    assert len(words) > 30
    assert sorted(words) == sorted(set(words))
