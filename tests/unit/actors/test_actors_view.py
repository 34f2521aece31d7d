"""The server of the view: who is let in, what is answered, and that it names files of the run only."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from actors.view.app import view_app
from pipeline.errors import InputError
from pipeline.mission.local import run_local
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare
from pipeline.mission.run_directory import write_run_directory
from pipeline.view.decisions import FILE

HERE = "http://127.0.0.1:8750"
OURS = {"origin": HERE, "content-type": "application/json"}


@pytest.fixture(scope="module")
def finished(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("view") / "run"
    prepared = prepare(small_mission)
    write_run_directory(prepared, run_local(prepared, plan(prepared), lambda *_: None), out)
    return out


@pytest.fixture
def client(finished: Path) -> TestClient:
    (finished / FILE).unlink(missing_ok=True)
    return TestClient(view_app(finished, None), base_url=HERE)


def test_the_numbers_are_those_of_the_summary(client: TestClient, finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    now = client.get("/api/now").json()
    assert now["state"] == "finished"
    for kind, key in (("found", "found"), ("possible", "possible")):
        shown = {p["id"]: p["probability"] for p in now["places"] if p["kind"] == kind}
        assert shown == {p["id"]: p["probability"] for p in summary[key]}
    assert now["run"]["verdict"] == summary["verdict"]
    assert now["run"]["streams"] == summary["streams"]
    flown = client.get("/api/flown").json()
    assert {f["stream"] for f in flown["flights"]} == {s["stream"] for s in summary["streams"]}
    assert flown["grid"]
    for path in ("/probability.png", "/pod.png", "/hillshade.png"):
        assert client.get(path).content.startswith(b"\x89PNG")


def test_a_place_was_seen_by_the_streams_that_found_it_at_these_seconds(
    client: TestClient, finished: Path
) -> None:
    places = [p for p in client.get("/api/now").json()["places"] if p["kind"] == "found"]
    assert places
    for place in places:
        seen = client.get("/api/saw", params={"e": place["east_m"], "n": place["north_m"]}).json()
        assert seen["latitude_deg"] == pytest.approx(place["latitude_deg"], abs=1e-6)
        for sighting in place["seen"]:
            assert any(
                s["stream"] == sighting["stream"]
                and s["from_s"] - 0.3 <= sighting["time_s"] <= s["to_s"] + 0.3
                for s in seen["seen"]
            )
        assert client.get(f"/crop/{place['id']}/0").content.startswith(b"\x89PNG")


def test_videos_are_sent_in_parts(client: TestClient) -> None:
    stream = client.get("/api/flown").json()["flights"][0]["stream"]
    part = client.get(f"/video/{stream}/0", headers={"range": "bytes=100-299"})
    assert part.status_code == 206
    assert len(part.content) == 200
    assert part.headers["content-range"].startswith("bytes 100-299/")


@pytest.mark.parametrize(
    "path",
    [
        "/video/..%2f..%2f..%2fetc%2fpasswd/0",
        "/video/nobody/0",
        "/video/drone-1/99",
        "/static/..%2fapp.py",
        "/static/../app.py",
        "/static/%2e%2e/guard.py",
        "/crop/9999/0",
        "/crop/1/-1",
        "/summary.json",
        "/decisions.jsonl",
    ],
)
def test_no_other_file_is_given(client: TestClient, path: str) -> None:
    assert client.get(path).status_code in (404, 405)


@pytest.mark.parametrize("text", ["", "nan", "inf", "1e99", "<b>"])
def test_a_point_that_is_none_is_refused(client: TestClient, text: str) -> None:
    assert client.get("/api/saw", params={"e": text, "n": "0"}).status_code == 400


def test_decisions_change_the_place_and_outlive_the_server(client: TestClient, finished: Path) -> None:
    place = client.get("/api/now").json()["places"][0]
    picture = client.get("/probability.png").content
    said = {"who": "Ana", "kind": "reject", "place": place["id"]}
    number = client.post("/api/decide", json=said, headers=OURS).json()["number"]
    again = TestClient(view_app(finished, None), base_url=HERE)
    shown = next(p for p in again.get("/api/now").json()["places"] if p["id"] == place["id"])
    odds = place["probability"] / (1.0 - place["probability"]) / 19.0
    assert shown["decided"] == pytest.approx(odds / (1.0 + odds), abs=1e-5)
    assert shown["probability"] == place["probability"]
    assert again.get("/probability.png").content != picture
    undo = {"who": "Ana", "kind": "undo", "undoes": number}
    assert again.post("/api/decide", json=undo, headers=OURS).status_code == 200
    assert client.get("/probability.png").content == picture
    assert client.get("/api/now").json()["places"][0] == place


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({"origin": "http://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": ""}, 403),
        ({"origin": "http://127.0.0.1:9999"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"content-type": "text/plain"}, 415),
        ({"content-type": "application/x-www-form-urlencoded"}, 415),
    ],
)
def test_another_origin_cannot_decide(
    client: TestClient, finished: Path, headers: dict[str, str], code: int
) -> None:
    body = json.dumps({"who": "Eve", "kind": "reject", "place": 1})
    assert client.post("/api/decide", content=body, headers=OURS | headers).status_code == code
    assert not (finished / FILE).exists()


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8750", "127.0.0.1.evil.example", "", "[::1"])
def test_a_name_that_was_led_here_is_not_answered(client: TestClient, host: str) -> None:
    answer = client.get("/api/now", headers={"host": host})
    assert answer.status_code == 403
    assert "places" not in answer.text


@pytest.mark.parametrize("host", ["localhost:8750", "127.0.0.1", "[::1]:8750"])
def test_names_of_loopback_are_answered(client: TestClient, host: str) -> None:
    assert client.get("/api/now", headers={"host": host}).status_code == 200


def test_without_the_token_nothing_is_given(finished: Path) -> None:
    app = view_app(finished, "secret")
    for path in ("/", "/api/now", "/probability.png", "/static/view.js", "/video/drone-1/0", "/?token=wrong"):
        assert TestClient(app, base_url=HERE).get(path, follow_redirects=False).status_code == 403
    for cookie in ("", "searchlight=wrong", "searchlight=", "secret"):
        answer = TestClient(app, base_url=HERE).get("/api/now", headers={"cookie": cookie})
        assert answer.status_code == 403
    known = TestClient(app, base_url="http://searchlight.test:8750")
    entered = known.get("/?token=secret", follow_redirects=False)
    assert (entered.status_code, entered.headers["location"]) == (303, "/")
    assert "httponly" in entered.headers["set-cookie"].lower()
    assert "samesite=strict" in entered.headers["set-cookie"].lower()
    assert known.get("/api/now").status_code == 200


def test_every_answer_forbids_what_is_not_ours(client: TestClient) -> None:
    for path in ("/", "/api/now", "/static/view.js", "/nothing"):
        headers = client.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "http" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cross-origin-resource-policy"] == "same-origin"


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{", b"\xff", b'{"who": "A"}', b'{"who": "A", "kind": "confirm", "place": 99}']
)
def test_a_decision_that_is_none_is_refused_and_not_written(
    client: TestClient, finished: Path, body: bytes
) -> None:
    assert client.post("/api/decide", content=body, headers=OURS).status_code == 400
    assert client.post("/api/decide", content=b"x" * 5000, headers=OURS).status_code == 413
    assert not (finished / FILE).exists() or not (finished / FILE).read_bytes()


def test_what_is_no_run_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run"):
        view_app(tmp_path, None)
    with pytest.raises(InputError, match="no such directory"):
        view_app(tmp_path / "absent", None)
