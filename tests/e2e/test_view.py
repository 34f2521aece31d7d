"""The page of a run in a real browser: what it shows is what the run says, and what is decided stays."""

from __future__ import annotations

import json
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn

from actors.view.app import view_app
from pipeline.mission.local import run_local
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare
from pipeline.mission.run_directory import write_run_directory
from pipeline.view.decisions import FILE, read_log

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium (Debian: apt-get install chromium)")
NAUGHTY = '<img src=x onerror="document.title=\'taken\'"><script>document.title="taken"</script>'


class Served:
    """A run at an address of loopback; it can be stopped, and come back there."""

    def __init__(self, run: Path) -> None:
        self.run = run
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.start()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def start(self) -> None:
        config = uvicorn.Config(view_app(self.run, None), port=self.port, log_level="error", lifespan="off")
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, daemon=True)
        self._thread.start()
        while not self._server.started:
            time.sleep(0.01)

    def stop(self) -> None:
        self._server.should_exit = True
        self._thread.join(10.0)


@pytest.fixture(scope="module")
def served(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    out = tmp_path_factory.mktemp("page") / "run"
    prepared = prepare(small_mission)
    write_run_directory(prepared, run_local(prepared, plan(prepared), lambda *_: None), out)
    # names come from files of others: here one that would be executed if it were taken for HTML
    summary = json.loads((out / "summary.json").read_text())
    summary["mission"] = NAUGHTY
    (out / "summary.json").write_text(json.dumps(summary))
    for kind in ("salient.geojson", "possible.geojson"):
        places = json.loads((out / kind).read_text())
        for feature in places["features"]:
            feature["properties"]["class"] = "person" + NAUGHTY
        (out / kind).write_text(json.dumps(places))
    server = Served(out)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def opened(
    browser: Any, served: Served, width: int = 1440, height: int = 900
) -> tuple[Any, list[str], list[str]]:
    """The page once it shows the run, with what went wrong and what it asked for."""
    page = browser.new_context(viewport={"width": width, "height": height}).new_page()
    wrong: list[str] = []
    asked: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(served.address)
    page.wait_for_selector("body[data-ready=yes]")
    return page, wrong, asked


def until(page: Any, expression: str) -> None:
    """Wait for it; the page's own policy forbids what Playwright would have it evaluate there."""
    end_s = time.monotonic() + 15.0
    while not page.evaluate(expression):
        assert time.monotonic() < end_s, expression
        time.sleep(0.05)


def test_what_is_shown_is_what_the_summary_says_and_what_is_decided_stays(
    browser: Any, served: Served
) -> None:
    summary = json.loads((served.run / "summary.json").read_text())
    (served.run / FILE).unlink(missing_ok=True)
    page, wrong, asked = opened(browser, served)
    assert page.inner_text("#mission") == NAUGHTY
    assert page.title() == "Searchlight"
    assert page.locator("#mission img, #found script, #found img").count() == 0
    assert page.inner_text("#verdict") == summary["verdict"]["sentence"]
    assert page.inner_text("#found-head") == f"Found: {len(summary['found'])}"
    assert page.inner_text("#possible-head") == f"Possible: {len(summary['possible'])}"
    best = max(summary["found"], key=lambda p: p["probability"])
    assert f"{round(100 * best['probability'])} %" in page.inner_text("#found li:first-child")
    for stream in summary["streams"]:
        assert page.locator(f"#going tr:has-text('{stream['stream']}')").first.inner_text().split()[1:3] == [
            str(stream["captured"]),
            str(stream["processed"]),
        ]

    page.fill("#who", "Ana")
    page.click("#state")
    page.keyboard.press("j")
    shown = int(page.get_attribute("[aria-current=true]", "data-place"))
    page.keyboard.press("r")
    page.wait_for_selector("[aria-current=true]:has-text('rejected')")
    assert "reject" in page.inner_text("#said")
    page.reload()
    page.wait_for_selector("body[data-ready=yes]")
    assert "rejected" in page.inner_text(f"[data-place='{shown}']")
    assert page.input_value("#who") == "Ana"

    other, _, _ = opened(browser, served)
    other.fill("#who", "Ben")
    other.click(f"[data-place='{shown}']")
    other.click("#confirm")
    page.wait_for_selector(f"[data-place='{shown}']:has-text('disagree')")  # without anybody's doing

    page.click(f"[data-place='{shown}']")
    page.keyboard.press("u")
    page.wait_for_selector(f"[data-place='{shown}']:has-text('confirmed')")
    page.keyboard.press("n")
    page.fill("#note-text", NAUGHTY)
    page.keyboard.press("Enter")
    page.wait_for_selector("#place li:has-text('note')")
    assert [d.kind for d in read_log(served.run).decisions] == ["reject", "confirm", "undo", "note"]
    assert page.title() == "Searchlight"
    assert wrong == []
    assert all(url.startswith((served.address, "data:")) for url in asked)


def test_a_point_says_who_saw_it_and_plays_it(browser: Any, served: Served) -> None:
    page, wrong, _ = opened(browser, served)
    box = page.locator("#map").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.wait_for_selector("#point li")
    page.click("#point li button")
    until(page, "document.querySelector('#video').readyState >= 2")
    assert page.evaluate("document.querySelector('#video').error") is None
    page.locator("#time").fill("0")
    assert page.inner_text("#moment").startswith("as of")
    first = page.locator("#found li").count()
    page.locator("#time").fill("1000")
    assert page.locator("#found li").count() >= first
    assert wrong == []


def test_a_server_that_was_gone_comes_back(browser: Any, served: Served) -> None:
    page, _, _ = opened(browser, served)
    served.stop()
    page.wait_for_selector("#state:has-text('does not answer')")
    assert page.locator("#found li").count() > 0
    served.start()
    page.wait_for_selector("#state:has-text('finished')")


@pytest.mark.parametrize(("width", "height"), [(390, 844), (768, 1024), (1440, 900)])
def test_it_fits_the_screen_can_be_touched_and_breaks_no_rule_of_accessibility(
    browser: Any, served: Served, width: int, height: int
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    page, _, _ = opened(browser, served, width, height)
    page.click("#found li button")
    page.keyboard.press("?")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    small = page.evaluate(
        "[...document.querySelectorAll('button, select, input, .leaflet-bar a')].filter(b => b.offsetParent)"
        ".filter(b => b.getBoundingClientRect().height < 44).map(b => b.outerHTML)"
    )
    assert small == []
    rules = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]}
    found = Axe().run(page, options=rules).response["violations"]
    assert [(v["id"], [n["html"][:200] for n in v["nodes"][:3]]) for v in found] == []
