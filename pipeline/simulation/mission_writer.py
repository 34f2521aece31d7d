"""A simulated mission on disk: the same files that a real team's drones leave, and the truth beside them."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.config.commented import commented_mission
from pipeline.config.scenario import load_scenario
from pipeline.errors import InputError
from pipeline.simulation.flight import Flight
from pipeline.simulation.mission_file import calibration_document, drone_name, mission_document
from pipeline.simulation.pose_noise import disturbed
from pipeline.simulation.rehearsal import Rehearsal, rehearse
from pipeline.simulation.render_pool import RenderPool
from pipeline.simulation.srt_writer import dji_srt
from pipeline.simulation.surface_model import write_surface_model
from pipeline.simulation.truth import LabelledFrame, boxes_coco, people_geojson
from pipeline.simulation.video_writer import write_video

#: name of what is under way, steps done, steps in all
Progress = Callable[[str, int, int], None]
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_NOISE_STREAM = 3


def simulate(scenario_path: Path, out: Path, *, progress: Progress, workers: int | None = None) -> Path:
    """Render a scenario into a new folder and return its mission file.

    out: absent or empty; it appears whole or not at all. workers: processes, by default one for each core;
    their number changes no byte. Raises InputError for an unusable scenario and for a folder in use.
    """
    scenario = load_scenario(scenario_path)
    _refuse_used(out)
    progress("scene", 0, 1)
    rehearsal = rehearse(scenario)
    progress("scene", 1, 1)
    return write_rehearsal(rehearsal, out, progress=progress, workers=workers)


def write_rehearsal(
    rehearsal: Rehearsal, out: Path, *, progress: Progress, workers: int | None = None
) -> Path:
    """Render a scenario made concrete; as ``simulate``."""
    with _appearing(out) as folder:
        _write_ground(folder, rehearsal)
        with RenderPool(rehearsal, workers or os.cpu_count() or 1) as pool:
            for number in range(len(rehearsal.flights)):
                _write_drone(folder, rehearsal, number, pool, progress)
        document = mission_document(rehearsal.scenario, out)
        head = "A simulated mission, written by searchlight simulate. What each key means stands above it."
        (folder / "mission.yaml").write_text(commented_mission(document, head), encoding="utf-8")
    return out / "mission.yaml"


def _write_ground(folder: Path, rehearsal: Rehearsal) -> None:
    scenario, frame = rehearsal.scenario, rehearsal.frame
    write_surface_model(folder / "terrain.tif", rehearsal.scene, frame, scenario.surface_model)
    _write_yaml(folder / "camera.yaml", calibration_document(scenario))
    (folder / "truth").mkdir()
    duration_s = max(float(flight.times_s[-1]) for flight in rehearsal.flights)
    people = people_geojson(rehearsal.scene, frame, scenario.start, duration_s)
    _write_json(folder / "truth" / "people.geojson", people)


def _write_drone(
    folder: Path, rehearsal: Rehearsal, number: int, pool: RenderPool, progress: Progress
) -> None:
    scenario, flight, name = rehearsal.scenario, rehearsal.flights[number], drone_name(number)
    _write_telemetry(folder / f"{name}.srt", rehearsal, number, flight)
    labelled: list[LabelledFrame] = []

    def images() -> Iterator[NDArray[np.uint8]]:
        for index, picture in enumerate(pool.pictures(number)):
            if index % scenario.boxes_every == 0:
                labelled.append(LabelledFrame(index, picture.people))
            yield picture.image
            progress(name, index + 1, len(flight.times_s))

    write_video(folder / f"{name}.mp4", images(), scenario.recording)
    rate = scenario.recording.frame_rate
    boxes = boxes_coco(f"{name}.mp4", rehearsal.camera, labelled, scenario.start, rate)
    _write_json(folder / "truth" / f"boxes-{name}.json", boxes)


def _write_telemetry(path: Path, rehearsal: Rehearsal, number: int, flight: Flight) -> None:
    rng = np.random.default_rng([rehearsal.scenario.seed, _NOISE_STREAM, number])
    told = disturbed(flight, rehearsal.scenario.pose_noise, rng)
    east, north = flight.positions_enu[:1, 0], flight.positions_enu[:1, 1]
    takeoff_height_m = float(rehearsal.scene.ground.height(east, north)[0])
    camera = rehearsal.camera
    focal_mm = _FILM_DIAGONAL_MM * camera.fx / math.hypot(camera.width, camera.height)
    text = dji_srt(told, rehearsal.frame, rehearsal.scenario.start, takeoff_height_m, focal_mm)
    path.write_text(text, encoding="utf-8")


def _refuse_used(out: Path) -> None:
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise InputError(out, "a folder that is in use", "a new or an empty folder")


@contextmanager
def _appearing(out: Path) -> Iterator[Path]:
    """A temporary folder beside out that takes its name when all is written, and goes away otherwise."""
    _refuse_used(out)
    absolute = out.absolute()
    temporary = absolute.with_name(f".{absolute.name}.{os.getpid()}.part")
    try:
        temporary.mkdir(parents=True)
        yield temporary
        os.replace(temporary, absolute)
    except OSError as error:
        raise InputError(
            out, f"a place that cannot be written ({error.strerror})", "a writable folder"
        ) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_yaml(path: Path, document: dict[str, Any]) -> None:
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")


def _write_json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document), encoding="utf-8")
