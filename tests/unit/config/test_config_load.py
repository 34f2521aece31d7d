from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.config.base import Strict, load
from pipeline.config.inventory import load_inventory
from pipeline.errors import InputError

Write = Callable[..., Path]
MACHINE = "{id: laptop, type: cpu-8, memory: {gigabytes: 16}, count: 2}"

FAULTS = [
    (
        MACHINE,
        "{id: laptop, typ: cpu-8, memory: {gigabytes: 16}}",
        4,
        "sites.0.machines.0.typ",
        "an unknown key",
        "type",
    ),
    (MACHINE, "{id: laptop, memory: {gigabytes: 16}}", 4, "sites.0.machines.0.type", "nothing", "a value"),
    (MACHINE, "{id: a b, type: t, memory: {gigabytes: 16}}", 4, "sites.0.machines.0.id", "'a b'", "A-Za-z"),
    (MACHINE, "7", 4, "sites.0.machines.0", "7", "keys and values"),
    ("memory: {gigabytes: 8}", "memory: 8", 7, "sites.0.machines.1.memory", "8", "{gigabytes: NUMBER}"),
    (
        "memory: {gigabytes: 8}",
        "memory: {mib: 8}",
        7,
        "sites.0.machines.1.memory",
        "the unit 'mib'",
        "gigabytes",
    ),
    (
        "memory: {gigabytes: 8}",
        "memory: {gigabytes: 8g}",
        7,
        "memory",
        "{'gigabytes': '8g'}",
        "a number of gigabytes",
    ),
    ("memory: {gigabytes: 8}", "memory: {gigabytes: -8}", 7, "memory", "{'gigabytes': -8}", "at least"),
    ("memory: {gigabytes: 8}", "memory: {gigabytes: .nan}", 7, "memory", "nan", "a number"),
    ("provider: cuda", "provider: tpu", 8, "sites.0.machines.1.provider", "'tpu'", "'cpu' or 'cuda'"),
    ("count: 2", "count: 0", 4, "sites.0.machines.0.count", "0", "greater than or equal to 1"),
    ("id: jetson", "id: laptop-2", 5, "sites.0.machines.1.id", "machine 'laptop-2' again", "once"),
    ("drone-1, site: van", "drone-1, site: vam", 10, "links.0.site", "'vam'", "one of the sites van"),
    ("stream: drone-2", "stream: drone-1", 11, "links.1", "link 'drone-1 -> van' again", "every link once"),
    ("type: gpu-s", "id: gpu-s", 6, "id", "the key twice", "it once"),
    ("type: gpu-s", "? [a]\n        : b", 6, "", "a key that is a list", "a name"),
    ("type: gpu-s", "type: !gpu s", 6, "", "not YAML", "valid YAML"),
    ("type: gpu-s", "type: 2001-99-99", 6, "", "not a timestamp", "valid YAML"),
    ("type: gpu-s", "type: !!int ''", 6, "", "not a int", "valid YAML"),
    ("type: gpu-s", "type: {gpu", 7, "", "not YAML", "valid YAML"),
]


@pytest.mark.parametrize(("old", "new", "line", "field", "found", "expected"), FAULTS)
def test_a_fault_is_named_with_line_field_value_and_remedy(
    write: Write, old: str, new: str, line: int, field: str, found: str, expected: str
) -> None:
    path = write("inventory", old, new)
    with pytest.raises(InputError) as caught:
        load_inventory(path)
    error = caught.value
    assert "\n" not in str(error)
    assert error.where.startswith(f"{path}:{line}")
    assert error.where.endswith(field)
    assert found in error.found
    assert expected in error.expected


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (None, "no file"),
        (b"", "no mapping"),
        (b"- a\n", "no mapping"),
        (b"\xff\xfe\x00", "an unreadable file"),
        (b"a: \x00", "not YAML"),
        (b'a: "\\UFFFFFFFF"', "not YAML"),
        (b"a: " + b"[" * 5000, "not YAML"),
        (b"a\tb: {", "not YAML"),
    ],
)
def test_what_is_no_yaml_mapping_is_one_line(tmp_path: Path, content: bytes | None, found: str) -> None:
    path = tmp_path / "inventory.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=found) as caught:
        load_inventory(path)
    assert "\n" not in str(caught.value)
    assert caught.value.where.startswith(str(path))


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unreadable"):
        load_inventory(tmp_path)


def test_a_path_that_cannot_exist_is_an_input_error() -> None:
    with pytest.raises(InputError, match="unreadable"):
        load_inventory(Path("a\0b"))


def test_an_alias_stands_for_its_value(write: Write) -> None:
    path = write("inventory", "{gigabytes: 16}", "&ram {gigabytes: 16}")
    path.write_text(path.read_text().replace("{gigabytes: 8}", "*ram"))
    machines = load_inventory(path).sites[0].machines
    assert machines[0].memory == machines[1].memory == 16e9


def test_aliases_that_double_or_contain_themselves_end(tmp_path: Path) -> None:
    path = tmp_path / "inventory.yaml"
    doubling = "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 40))
    for text in ("a0: &a0 [x]\n" + doubling, "sites: &a [*a]", "sites: &a {sites: *a}", "a: &a {<<: *a}"):
        path.write_text(text)
        with pytest.raises(InputError) as caught:
            load_inventory(path)
        assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("name: FILL IN\nsize: {meters: 1}\n", ["1 name"]),
        ("name: a\nsize: {meters: FILL IN}\n", ["2 size.meters"]),
        ("name: FILL IN\nparts: [a, FILL IN]\n", ["1 name", "2 parts.1"]),
    ],
)
def test_every_value_that_is_still_to_be_filled_in_is_named(
    tmp_path: Path, text: str, lines: list[str]
) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        load(path, Strict)
    found = str(refused.value).splitlines()
    assert [line.split(": found")[0] for line in found] == [f"{path}:{where}" for where in lines]
    assert all("found FILL IN; expected a value in its place" in line for line in found)
