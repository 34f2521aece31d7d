"""Whatever is in a configuration file: a valid record, or an InputError of one line."""

import runpy
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config.camera import load_camera
from pipeline.config.inventory import load_inventory
from pipeline.config.mission import load_mission
from pipeline.config.pool import load_pool
from pipeline.errors import InputError

TEXTS: dict[str, str] = runpy.run_path(str(Path(__file__).parents[1] / "unit" / "config" / "conftest.py"))[
    "TEXTS"
]
LOAD: dict[str, Callable[[Path], object]] = {
    "mission": load_mission,
    "pool": load_pool,
    "inventory": load_inventory,
    "camera": load_camera,
}
YAML_BITS = st.sampled_from(
    [
        "{",
        "}",
        "[",
        "]",
        ": ",
        "- ",
        "\n",
        "\n  ",
        "&a ",
        "*a",
        "!!int ",
        "!!set ",
        "!!timestamp ",
        "<<: ",
        "? ",
        "#",
        "|",
        ">",
        '"',
        "'",
        "\\U00110000",
        "\t",
        "%",
        "~",
        ".inf",
        ".nan",
        "-1",
        "0x_",
        "0b_",
        "1e400",
        "9" * 400,
        "2001-99-99",
        "12:61",
        "null",
        "true",
        "{meters: 1}",
        "{meters: .inf}",
        "{mbps: a}",
        "\x85",
        "\ufeff",
        "\x00",
    ]
)
NEW = YAML_BITS | st.text(max_size=6) | st.lists(YAML_BITS, max_size=5).map("".join)


@st.composite
def mangled(draw: st.DrawFn, text: str) -> str:
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(text)))
        text = text[:start] + draw(NEW) + text[start + draw(st.integers(0, 30)) :]
    return text


def fault_of(kind: str, path: Path) -> str | None:
    try:
        LOAD[kind](path)
    except InputError as error:
        return str(error)
    return None


def load_or_one_line(kind: str, text: str) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "x.yaml"
        path.write_text(text, encoding="utf-8", errors="replace", newline="")
        message = fault_of(kind, path)
        assert message is None or (message.startswith(str(path)) and len(message.splitlines()) == 1)


@pytest.mark.parametrize("kind", LOAD)
@given(data=st.data())
@settings(max_examples=120, deadline=None)
def test_a_mangled_file_gives_a_record_or_one_line(kind: str, data: st.DataObject) -> None:
    load_or_one_line(kind, data.draw(mangled(TEXTS[kind])))


@pytest.mark.parametrize("kind", LOAD)
@given(text=st.lists(NEW, max_size=30).map("".join))
@settings(max_examples=60, deadline=None)
def test_any_text_gives_a_record_or_one_line(kind: str, text: str) -> None:
    load_or_one_line(kind, text)
