import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.parts import part_of

ROOT = Path(__file__).resolve().parents[2]
#: seven tests, of which one fails until a file is there
SUITE = """
import pathlib, pytest
@pytest.mark.parametrize("k", range(6))
def test_each(k):
    pass
def test_last():
    assert pathlib.Path({flag!r}).exists()
"""


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    (tmp_path / "suite").mkdir()
    (tmp_path / "suite/test_of_seven.py").write_text(SUITE.format(flag=str(tmp_path / "flag")))
    return tmp_path


def _run(suite: Path, part: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-p", "tests.parts", "-p", "no:cacheprovider", "--part", part]
    more = [
        "--results",
        str(suite / "results"),
        "--rootdir",
        str(suite),
        "-c",
        "/dev/null",
        str(suite / "suite"),
    ]
    return subprocess.run([*command, *more], cwd=ROOT, capture_output=True, text=True, check=False)


def _held(suite: Path) -> list[dict]:  # type: ignore[type-arg]
    return [json.loads(path.read_text()) for path in sorted((suite / "results").iterdir())]


@pytest.mark.slow
def test_the_parts_are_the_whole_and_a_part_goes_on_where_it_was_left(suite: Path) -> None:
    assert [_run(suite, f"{k}/3").returncode for k in (1, 2, 3)] == [1, 0, 0]
    held = _held(suite)
    assert {h["part"] for h in held} == {"1/3", "2/3", "3/3"}
    assert sorted(name for h in held for name in h["tests"]) == sorted(
        [f"suite/test_of_seven.py::test_each[{k}]" for k in range(6)] + ["suite/test_of_seven.py::test_last"]
    )
    first = next(h for h in held if h["part"] == "1/3")
    assert first["outcomes"] == {"failed": 1, "passed": 2}
    assert all(test["seconds"] >= 0.0 and test["began"].endswith("Z") for test in first["tests"].values())
    (suite / "flag").touch()
    again = _run(suite, "1/3")
    assert again.returncode == 0
    assert "1 passed, 6 deselected" in again.stdout, "what passed is not run again"
    assert len(_held(suite)) == 3, "the same file goes on"
    assert next(h for h in _held(suite) if h["part"] == "1/3")["outcomes"] == {"passed": 3}


def test_another_source_begins_anew(suite: Path) -> None:
    _run(suite, "2/3")
    (path,) = (suite / "results").iterdir()
    path.write_text(path.read_text().replace('"source": "', '"source": "0'))
    assert "2 passed" in _run(suite, "2/3").stdout


@pytest.mark.parametrize("wrong", ["", "0/3", "4/3", "3", "a/b", "1/0", "-1/2", "1/2/3"])
def test_a_part_that_is_none_is_refused(wrong: str) -> None:
    with pytest.raises(pytest.UsageError, match="expected k/n"):
        part_of(wrong)
