"""The nodes of a cluster: their version, the models that they lack, what they find wrong."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest

from actors.nodes import MODELS_VARIABLE, Offer, Program, models_folder, program, require_same_program
from pipeline.config.pool import load_pool
from pipeline.errors import InputError, RunFailedError
from pipeline.storage.kept_models import KeptModels, sha256_of

ROOT = Path(__file__).resolve().parents[3]


def _asked(answers: dict[str, Program | Exception]) -> Callable[..., Program]:
    def ask(site: str, work: object, *arguments: object) -> Program:
        answer = answers[site]
        if isinstance(answer, Exception):
            raise answer
        return answer

    return ask


def test_nodes_of_this_version_are_let_through() -> None:
    require_same_program(["ground", "drone-1"], _asked({"ground": program(), "drone-1": program()}))


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (Program("9.9.9", "0" * 64), "Searchlight 9.9.9 (source 000000000000)"),
        (Program(program().version, "f" * 64), "(source ffffffffffff)"),
        (RunFailedError("no module named 'actors.nodes'"), "cannot say which Searchlight it runs"),
    ],
)
def test_a_node_of_another_version_is_named_in_one_line(other: Program | Exception, words: str) -> None:
    with pytest.raises(InputError) as caught:
        require_same_program(["ground", "drone-1"], _asked({"ground": program(), "drone-1": other}))
    assert caught.value.where == "site drone-1"
    assert words in caught.value.found
    assert program().words in caught.value.expected
    assert "\n" not in str(caught.value)


def test_a_model_that_is_there_is_not_sent(tmp_path: Path) -> None:
    model = tmp_path / "a.onnx"
    model.write_bytes(b"a model")
    kept = KeptModels(tmp_path / "kept", _never)
    assert kept.path(model, sha256_of(model)) == model


def _never(sha256: str) -> bytes:
    raise AssertionError(sha256)


@pytest.mark.parametrize("there", [None, b"another model of the same name"])
def test_a_model_that_is_absent_or_another_is_fetched_once_and_kept(
    there: bytes | None, tmp_path: Path
) -> None:
    model, asked = tmp_path / "a.onnx", []
    if there is not None:
        model.write_bytes(there)
    sha256 = hashlib.sha256(b"a model").hexdigest()

    def fetch(wanted: str) -> bytes:
        asked.append(wanted)
        return b"a model"

    kept = KeptModels(tmp_path / "kept", fetch)
    paths = [kept.path(model, sha256) for _ in range(3)]
    assert asked == [sha256]
    assert {path.read_bytes() for path in paths} == {b"a model"}
    paths[0].write_bytes(b"cut of")
    assert kept.path(model, sha256).read_bytes() == b"a model"


def test_what_was_fetched_and_is_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="sha256"):
        KeptModels(tmp_path / "kept", lambda _: b"something else").path(tmp_path / "a.onnx", "0" * 64)
    assert not (tmp_path / "kept").exists()


def test_a_detector_is_opened_from_where_its_model_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(MODELS_VARIABLE, str(tmp_path))
    assert models_folder() == tmp_path
    detector = load_pool(ROOT / "configs/pools/demo.yaml").detectors[0]
    assert detector.model is not None
    assert Offer().on_this_node(detector) == detector
    assert Offer({detector.id: sha256_of(detector.model)}).on_this_node(detector).model == detector.model
