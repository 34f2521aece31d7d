"""What leaves the team says roughly where, and shows nobody."""

from __future__ import annotations

import io
import json
import re
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pypdf
import pytest
from PIL import Image
from run_folder import picture_png, write_run

from pipeline.errors import InputError
from pipeline.outputs.exports.redaction import BLOCKS, SENTENCE, blurred, redacted
from pipeline.outputs.exports.registry import FORMATS, write_exports
from pipeline.outputs.exports.view import RunView, read_run

AT = datetime(2026, 5, 1, 12, tzinfo=UTC)
LEAVING = [name for name, kind in FORMATS.items() if not kind.exact]


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunView, Path]:
    folder = tmp_path_factory.mktemp("redacted")
    view = read_run(write_run(folder / "run"), AT)
    write_exports(folder / "out", redacted(view), LEAVING)
    return view, folder / "out"


def everything(folder: Path) -> dict[str, str]:
    """All text of all files, unpacked."""
    texts: dict[str, str] = {}
    for path in (p for p in folder.rglob("*") if p.is_file()):
        if path.suffix == ".kmz":
            with zipfile.ZipFile(path) as archive:
                texts[path.name] = " ".join([*archive.namelist(), archive.read("doc.kml").decode()])
        elif path.suffix == ".pdf":
            texts[path.name] = " ".join(page.extract_text() for page in pypdf.PdfReader(path).pages)
        else:
            texts[path.name] = path.read_bytes().decode("utf-8", "replace")
    return texts


def test_no_file_holds_an_exact_position_or_a_name(left: tuple[RunView, Path]) -> None:
    view, out = left
    for name, text in everything(out).items():
        for place in view.places:
            for degrees in (place.latitude_deg, place.longitude_deg):
                # more than the two decimals that are left, with whatever follows
                assert f"{degrees:.9f}"[:-4] not in text, name
            assert place.mgrs not in text, name
        for word in ("drone-1", "drone-2", "DJI_0001", "laptop:small"):
            assert word not in text, (name, word)


def test_every_number_that_could_be_a_position_is_coarse(left: tuple[RunView, Path]) -> None:
    _, out = left
    for feature in json.loads((out / "places.geojson").read_text())["features"]:
        assert feature["geometry"]["type"] == "Point"
        assert len(feature["geometry"]["coordinates"]) == 2
        assert all(round(c, 2) == c for c in feature["geometry"]["coordinates"])
        assert re.fullmatch(r"\d+[A-Z] [A-Z]{2} \d\d \d\d", feature["properties"]["mgrs"])
        assert not {"utm", "error_ellipse_95", "height_m", "streams"} & set(feature["properties"])


def test_people_read_no_more_decimals_than_are_meant(left: tuple[RunView, Path]) -> None:
    _, out = left
    texts = everything(out)
    for name in ("report.pdf", "places.kmz", "places.gpx", "place-1.cot"):
        assert "63.40, 10.40" in " ".join(texts[name].split()), name
        assert "63.4000000" not in texts[name].partition("Latitude, longitude")[2].partition("Seen")[0], name


def test_every_file_says_what_was_left_out(left: tuple[RunView, Path]) -> None:
    _, out = left
    for name, text in everything(out).items():
        assert SENTENCE[:40] in " ".join(text.split()), name


def test_pictures_are_blurred_in_every_file_that_has_them(left: tuple[RunView, Path]) -> None:
    view, out = left
    originals = [p.png for place in view.places for p in place.pictures]
    with zipfile.ZipFile(out / "places.kmz") as archive:
        inside = [archive.read(n) for n in archive.namelist() if n.endswith(".png")]
    assert len(inside) == len(originals)
    assert not set(inside) & set(originals)
    from_pdf = [
        np.asarray(i.image) for page in pypdf.PdfReader(out / "report.pdf").pages for i in page.images
    ]
    for pixels in [*(np.asarray(Image.open(io.BytesIO(png))) for png in inside), *from_pdf]:
        # neighbours of noise differ by 85 on average; of 18 pixels a block, softly drawn, by a few
        assert np.abs(np.diff(pixels.astype(int), axis=1)).mean() < 3.0


@pytest.mark.parametrize("size", [1, 7, 8, 144, 301])
def test_a_blur_keeps_no_more_than_its_blocks(size: int) -> None:
    png = picture_png(1, size)
    soft = np.asarray(Image.open(io.BytesIO(blurred(png))))
    assert soft.shape == (size, size, 3)
    if size > BLOCKS:
        # the same blocks, other pixels within them: the same picture comes out
        block = size // BLOCKS
        if size % BLOCKS == 0:
            pixels = np.array(Image.open(io.BytesIO(png)))
            turned = pixels.reshape(BLOCKS, block, BLOCKS, block, 3)[:, ::-1, :, ::-1].reshape(pixels.shape)
            buffer = io.BytesIO()
            Image.fromarray(turned).save(buffer, format="PNG")
            again = np.asarray(Image.open(io.BytesIO(blurred(buffer.getvalue()))))
            np.testing.assert_array_equal(soft, again)


def test_what_is_nothing_but_positions_is_refused(left: tuple[RunView, Path], tmp_path: Path) -> None:
    view, _ = left
    with pytest.raises(InputError, match="cog"):
        write_exports(tmp_path, redacted(view), ["csv", "cog"])
    assert list(tmp_path.iterdir()) == []
