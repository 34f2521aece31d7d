"""The web application that shows one run, see docs/view.md."""

from __future__ import annotations

import io
import json
import math
import threading
from collections import OrderedDict
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from PIL import Image
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from xstatic.pkg import leaflet

from actors.view.guard import Guard
from pipeline.errors import InputError, SearchlightError
from pipeline.ingest.video.recordings import open_recordings
from pipeline.outputs.live_names import FOUND, REDUCER, STATUS
from pipeline.view.decisions import FILE as DECISIONS
from pipeline.view.decisions import append, read_log
from pipeline.view.files import MAP, find_run
from pipeline.view.page import RunPage
from pipeline.view.pictures import hillshade_png, layer_png

STATIC = Path(__file__).parent / "static"
_MOST_BODY = 4096
_MOST_CROPS = 400
#: half the side of a crop, pixels
_CROP_PX = 90


class Viewer:
    """What the routes share: the run as it is now, and pictures that were cut out already."""

    def __init__(self, run: Path) -> None:
        """Raises InputError if there is no run."""
        self._run = run
        self._lock = threading.Lock()
        self._crops: OrderedDict[tuple[Any, ...], bytes] = OrderedDict()
        self._page: tuple[str, RunPage] | None = None
        self.page()

    def version(self) -> str:
        """Another one whenever anything may have changed."""
        return f"{self.map_version()}-{self._stamps(REDUCER, STATUS)}"

    def map_version(self) -> str:
        """Another one whenever places, layer or decisions may have changed."""
        stamps = self._stamps(FOUND, MAP, "summary.json")
        return f"{find_run(self._run).state}-{stamps}-{_stamp(self._run / DECISIONS)}"

    def _stamps(self, *names: str) -> str:
        folder = find_run(self._run).folder
        return "-".join(_stamp(folder / name) for name in names)

    def page(self) -> RunPage:
        """The run as it is now."""
        with self._lock:
            version = self.version()
            if self._page is None or self._page[0] != version:
                self._page = version, RunPage(find_run(self._run))
            return self._page[1]

    def decide(self, said: dict[str, Any]) -> dict[str, Any]:
        """Write a decision down. Raises InputError for one that is none."""
        fields: dict[str, Any] = {name: said.get(name) for name in ("who", "kind")}
        fields |= {
            "text": said.get("text", ""),
            "undoes": said.get("undoes", 0) if said.get("kind") == "undo" else 0,
        }
        fields |= self._about(said)
        at = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        decision = append(self._run, at, fields)
        return {"number": decision.number}

    def _about(self, said: dict[str, Any]) -> dict[str, Any]:
        """The place that a decision is of; it need not be there any more to take one back."""
        if said.get("kind") == "undo":
            standing = read_log(self._run).standing
            former = next((d for d in standing if d.number == said.get("undoes")), None)
            if former is None:
                raise InputError("undoes", repr(said.get("undoes"))[:40], "a decision that stands")
            named = ("place", "class_name", "latitude_deg", "longitude_deg")
            return {name: getattr(former, name) for name in named}
        number = said.get("place", 0)
        place = next((p for p in self.page().places if p.id == number), None)
        if place is None:
            raise InputError("place", repr(number)[:40], "the number of a place of the map")
        return {
            "place": place.id,
            "class_name": place.class_name,
            "latitude_deg": place.latitude_deg,
            "longitude_deg": place.longitude_deg,
        }

    def crop(self, place_id: int, number: int) -> bytes | None:
        """What one of a place's sightings shows: cut from the video, or if that is gone, as the run has kept it."""
        page = self.page()
        place = next((p for p in page.places if p.id == place_id), None)
        if place is None or not 0 <= number < max(1, len(place.sightings)):
            return None
        if place.sightings:
            seen = place.sightings[number]
            key = (seen["stream"], seen["time_s"], seen["x"], seen["y"])
            if key not in self._crops:
                with self._lock:
                    picture = _cut(page, *key)
                if picture is not None:
                    self._crops[key] = picture
                    while len(self._crops) > _MOST_CROPS:
                        self._crops.popitem(last=False)
            if key in self._crops:
                return self._crops[key]
        kept = self._run / "crops" / f"place-{place.id}.png"
        return (
            kept.read_bytes() if number == 0 and page.folder.state == "finished" and kept.is_file() else None
        )

    def video(self, stream: str, number: int) -> Path | None:
        """A video file of the run, if it is still there; only files that the run names."""
        for flight in self.page().flights:
            if flight.stream == stream and 0 <= number < len(flight.videos):
                path = Path(flight.videos[number][0])
                return path if path.is_file() else None
        return None


def _cut(page: RunPage, stream: str, time_s: float, x: float | None, y: float | None) -> bytes | None:
    flight = next((f for f in page.flights if f.stream == stream), None)
    where = None if flight is None else flight.video_at(time_s)
    if flight is None or where is None or x is None or y is None:
        return None
    path = Path(flight.videos[where[0]][0])
    if not path.is_file():
        return None
    try:
        _, image = next(iter(open_recordings([path]).images_at([where[1]])))
    except (SearchlightError, StopIteration):
        return None
    height, width = image.shape[:2]
    left = min(max(0, int(x) - _CROP_PX), max(0, width - 2 * _CROP_PX))
    top = min(max(0, int(y - 1.3 * _CROP_PX)), max(0, height - 2 * _CROP_PX))
    part = Image.fromarray(image[top : top + 2 * _CROP_PX, left : left + 2 * _CROP_PX])
    buffer = io.BytesIO()
    part.save(buffer, "PNG")
    return buffer.getvalue()


def _stamp(path: Path) -> str:
    try:
        state = path.stat()
    except OSError:
        return "0"
    return f"{state.st_mtime_ns:x}.{state.st_size:x}"


def view_app(run: Path, token: str | None) -> Starlette:
    """The application. token: that whoever looks must have; None: none, for loopback. Raises InputError if no run."""
    viewer = Viewer(run)

    def answering(answer: Callable[[Request], Response]) -> Callable[[Request], Any]:
        async def endpoint(request: Request) -> Response:
            try:
                return await run_in_threadpool(answer, request)
            except InputError as error:
                return JSONResponse({"error": str(error)}, 400)

        return endpoint

    def picture(name: str) -> Callable[[Request], Response]:
        def answer(_: Request) -> Response:
            layer = viewer.page().decided_layer
            return _absent() if layer is None else Response(layer_png(layer, name), media_type="image/png")

        return answer

    def hillshade(_: Request) -> Response:
        ground = viewer.page().ground
        return _absent() if ground is None else Response(hillshade_png(ground), media_type="image/png")

    def version(_: Request) -> Response:
        return JSONResponse({"version": viewer.version(), "map": viewer.map_version()})

    def saw(request: Request) -> Response:
        east, north = _number(request, "e"), _number(request, "n")
        return JSONResponse(viewer.page().saw(east, north))

    def crop(request: Request) -> Response:
        data = viewer.crop(request.path_params["place"], request.path_params["number"])
        return _absent() if data is None else Response(data, media_type="image/png")

    def video(request: Request) -> Response:
        path = viewer.video(request.path_params["stream"], request.path_params["number"])
        return _absent() if path is None else FileResponse(path)

    async def decide(request: Request) -> Response:
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > _MOST_BODY:
                return JSONResponse({"error": "too long"}, 413)
        try:
            said = json.loads(body)
            if not isinstance(said, dict):
                raise ValueError
            return JSONResponse(await run_in_threadpool(viewer.decide, said))
        except (ValueError, TypeError):
            return JSONResponse({"error": "no decision"}, 400)
        except InputError as error:
            return JSONResponse({"error": str(error)}, 400)
        except OSError as error:
            return JSONResponse({"error": f"not written: {error.strerror}"}, 507)

    return Starlette(
        routes=[
            Route("/", answering(lambda _: FileResponse(STATIC / "index.html"))),
            Route("/api/version", answering(version)),
            Route("/api/now", answering(lambda _: JSONResponse(viewer.page().now()))),
            Route("/api/said", answering(lambda _: JSONResponse(viewer.page().said()))),
            Route("/api/flown", answering(lambda _: JSONResponse(viewer.page().flown()))),
            Route("/api/saw", answering(saw)),
            Route("/api/decide", decide, methods=["POST"]),
            Route("/probability.png", answering(picture("probability"))),
            Route("/pod.png", answering(picture("pod"))),
            Route("/hillshade.png", answering(hillshade)),
            Route("/crop/{place:int}/{number:int}", answering(crop)),
            Route("/video/{stream}/{number:int}", answering(video)),
            Mount("/static/leaflet", StaticFiles(directory=leaflet.BASE_DIR)),
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        middleware=[Middleware(Guard, token=token)],
    )


def _number(request: Request, name: str) -> float:
    text = request.query_params.get(name, "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or abs(value) > 1e7:
        raise InputError(name, text[:40], "metres in the map frame")
    return value


def _absent() -> Response:
    return PlainTextResponse("not there", 404)
