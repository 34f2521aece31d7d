"""What the plan says is what sessions and encoders are started with: fakes record how they were called."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnxruntime
import pytest
import yaml

from actors import machine
from actors.machine import MachineActor
from pipeline.allocation import literal as literal_program
from pipeline.allocation.build import build_problem
from pipeline.allocation.decomposed import solve
from pipeline.allocation.plan import Plan, assignment_to_json, plan_from_json, plan_to_json
from pipeline.config.inventory import Inventory
from pipeline.config.pool import PoolDetector, load_pool
from pipeline.config.processing import Processing
from pipeline.detection import session as session_module
from pipeline.detection.model_file import sha256_of
from pipeline.errors import InputError
from pipeline.mission import local
from pipeline.mission.local import make_detectors
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages import source as source_module
from pipeline.mission.stages.source import SourceStage
from pipeline.sensor.setup import Tiling

NANO = Path(__file__).parents[3] / "configs" / "detectors" / "nano.onnx"
LAYERS = {"person": 0, "boat": 4}
#: scale of the calibration by codec and bitrate
SCALES = {("h264", 1e6): 1.0, ("h264", 4e6): 4.0, ("h265", 1e6): 7.0, ("h265", 4e6): 9.0}
MEASURED = [
    {"codec": codec, "bitrate": {"bps": bitrate}, "picture_width": 1024, "false_boxes": 0.1}
    | {"calibration": {"scale": scale, "offset": 0.0}}
    for (codec, bitrate), scale in SCALES.items()
]


def row(name: str, machine: str, **changes) -> dict:
    fields = {
        "id": name,
        "model": str(NANO),
        "sha256": sha256_of(NANO),
        "memory": {"megabytes": 50},
        "accuracy": [
            {"bitrate": {"mbps": 1}, "accuracy": 0.4},
            {"bitrate": {"mbps": 4}, "accuracy": 0.6},
        ],
        "times": [{"machine": machine, "mean": {"milliseconds": 150}, "threads": 2, "provider": "cpu"}],
        "classes": {"boat": ["person"]},
    }
    return fields | changes


@pytest.fixture
def prepared(tmp_path):
    rows = [
        row("tiled", "small", tiles={"size": [400, 300], "overlap": 0.25, "whole": True}),
        row("whole", "big", times=[{"machine": "big", "mean": {"milliseconds": 150}, "threads": 3}]),
    ]
    path = tmp_path / "pool.yaml"
    path.write_text(yaml.safe_dump({"detectors": rows}), encoding="utf-8")
    processing = Processing.model_validate(
        {
            "frame_rate": {"hertz": 10},
            "max_processing_time": {"seconds": 1},
            "bitrates": [{"mbps": 1}, {"mbps": 4}],
            "detectors_per_stream": 3,
        }
    )
    inventory = Inventory.model_validate(
        {
            "sites": [
                {"id": "drone", "machines": [{"id": "m", "type": "small", "memory": {"gigabytes": 2}}]},
                {"id": "ground", "machines": [{"id": "g", "type": "big", "memory": {"gigabytes": 8}}]},
            ],
            "links": [{"stream": "v", "site": "ground", "bandwidth": {"mbps": 5}}],
        }
    )
    pool = load_pool(path)
    problem = build_problem({"v": "drone"}, processing, inventory, pool, where=path)
    return SimpleNamespace(
        problem=problem,
        pool=pool,
        layers=LAYERS,
        mission=SimpleNamespace(processing=processing),
        runnable=lambda name: next(d for d in pool.detectors if d.id == name),
    )


@pytest.fixture
def plan(prepared) -> Plan:
    found = solve(prepared.problem, time_limit_s=20.0)
    assert {a.pool_detector for a in found.assignments} == {"tiled", "whole"}
    return found


@pytest.fixture
def opened(monkeypatch):
    """Every session: (provider, threads, shapes of pictures)."""
    sessions = []
    real = onnxruntime.InferenceSession

    class Recording:
        def __init__(self, model, options, providers):
            self.shapes = []
            sessions.append((providers, options.intra_op_num_threads, self.shapes))
            self._real = real(model, options, providers=providers)

        def run(self, names, inputs):
            self.shapes += [value.shape for value in inputs.values()]
            return self._real.run(names, inputs)

        def __getattr__(self, name):
            return getattr(self._real, name)

    monkeypatch.setattr(session_module.onnxruntime, "InferenceSession", Recording)
    return sessions


def test_sessions_have_the_plan_s_provider_threads_size_tiling_and_classes(prepared, plan, opened):
    stages = make_detectors(prepared, plan)
    assert len(opened) == len(stages)
    image = np.zeros((300, 700, 3), np.uint8)
    for (providers, threads, shapes), a in zip(opened, plan.assignments, strict=True):
        expected = {"tiled": 2, "whole": 3}[a.pool_detector]
        assert (
            (providers, threads)
            == (["CPUExecutionProvider"], expected)
            == (["CPUExecutionProvider"], a.setup.threads)
        )
        shapes.clear()
        detector = stages[a.stream, a.detector]._detector
        detector.detect(image)
        # 700 x 300 in tiles of 400 x 300 that overlap by a quarter: two, and the whole
        assert shapes == [(1, 176, 320, 3)] * (3 if a.setup.tiling else 1)
        assert a.setup.tiling == (Tiling(400, 300, 0.25, True) if a.pool_detector == "tiled" else None)
        assert detector.class_ids == {0, 4}


def test_encoders_have_the_plan_s_bitrate_and_rate_over_the_period(prepared, plan, monkeypatch):
    encoders = []
    monkeypatch.setattr(
        source_module, "Encoder", lambda *of, **how: encoders.append((of, how)) or SimpleNamespace()
    )
    source = SimpleNamespace(sent_size=(640, 480))
    stream = SimpleNamespace(stream="v", processing_rate_hz=10.0, codec="h264", source=source)

    stage = SourceStage(stream, plan.assignments, SimpleNamespace())
    assert len(encoders) == len(stage.epoch.substreams) == len(plan.assignments)
    for (of, how), a in zip(encoders, (o.assignment for o in stage.epoch.substreams), strict=True):
        assert of == ("h264", 640, 480)
        assert how["bitrate_bps"] == a.bitrate_bps / a.period
        assert how["frame_rate_hz"] == 10.0 / a.period


def test_the_setup_survives_the_plan_s_file_and_both_solvers_give_the_same(prepared, plan):
    again = plan_from_json(plan_to_json(plan, prepared.problem), "plan.json")
    assert again.assignments == plan.assignments
    literal = literal_program.solve(prepared.problem, time_limit_s=20.0)
    by_id = {d.id: d.setup for d in prepared.problem.detectors}
    assert all(a.setup == by_id[a.detector] for a in (*plan.assignments, *literal.assignments))


def test_what_a_machine_lacks_is_refused_before_the_start_with_the_machine_s_name(prepared, plan):
    from dataclasses import replace

    a = plan.assignments[0]
    wanting = replace(a, setup=replace(a.setup, provider="cuda"))
    if "CUDAExecutionProvider" in onnxruntime.get_available_providers():
        pytest.skip("this machine has CUDA")
    actor = MachineActor("m", "127.0.0.1", "h264")
    with pytest.raises(InputError, match=r"machine m: .*nano\.onnx: found provider 'cuda'"):
        actor._opened(wanting, prepared.runnable(a.pool_detector), LAYERS)


def test_cuda_times_on_a_machine_without_cuda_are_refused(tmp_path):
    path = tmp_path / "pool.yaml"
    times = [{"machine": "big", "mean": {"milliseconds": 4}, "provider": "cuda"}]
    path.write_text(yaml.safe_dump({"detectors": [row("fast", "big", times=times)]}), encoding="utf-8")
    inventory = Inventory.model_validate(
        {"sites": [{"id": "s", "machines": [{"id": "m", "type": "big", "memory": {"gigabytes": 2}}]}]}
    )
    processing = Processing.model_validate(
        {"frame_rate": {"hertz": 1}, "max_processing_time": {"seconds": 1}, "bitrates": [{"mbps": 1}]}
    )
    with pytest.raises(InputError, match=r"machine m\.provider: found cpu; expected cuda"):
        build_problem({"v": "s"}, processing, inventory, load_pool(path), where=path)


def test_a_file_that_is_not_the_one_of_the_pool_is_refused(prepared):
    from pipeline.detection import open_pool_detector

    other = prepared.runnable("whole").model_copy(update={"sha256": "0" * 64})
    with pytest.raises(InputError, match=r"nano\.onnx: found a file of sha256 .*expected 000000000000"):
        open_pool_detector(other)


def test_what_detections_are_worth_is_taken_at_the_plan_s_bitrate_and_codec(prepared, plan, monkeypatch):
    seen = []
    monkeypatch.setattr(
        local, "open_pool_detector", lambda row, layers, setup: seen.append(row.calibration) or object()
    )
    monkeypatch.setattr(local, "DetectorStage", lambda detector, codec: codec)
    rows = [
        PoolDetector.model_validate(row(d.id, "small", operating_points=MEASURED))
        for d in prepared.pool.detectors
    ]
    prepared.pool = prepared.pool.model_copy(update={"detectors": tuple(rows)})
    prepared.runnable = lambda name: next(d for d in rows if d.id == name)
    assignments = tuple(
        replace(a, codec=codec) for a, codec in zip(plan.assignments, ("h264", "h265"), strict=True)
    )
    changed = replace(plan, assignments=assignments)
    assert list(local.make_detectors(prepared, changed).values()) == ["h264", "h265"]
    assert [c.scale for c in seen] == [SCALES[a.codec, a.bitrate_bps] for a in assignments]
    worth = local.substream_models(prepared, changed)
    for a in assignments:
        assert worth[a.stream, a.detector].lowers == {1e6: 0.4, 4e6: 0.6}[a.bitrate_bps] / 0.6
        assert worth[a.stream, a.detector].raises == 1.0


def test_the_reducer_is_handed_what_each_substream_is_worth(prepared, plan, monkeypatch):
    handed = {}
    monkeypatch.setattr(local, "Fuser", lambda *_, **named: handed.update(named))
    monkeypatch.setattr(local, "Sequencer", lambda *_: None)
    fusion = SimpleNamespace(lateness=1.0)
    prepared.mission = SimpleNamespace(processing=prepared.mission.processing, fusion=fusion)
    prepared.terrain, prepared.cameras, prepared.streams, prepared.onto = None, {}, (), None
    prepared.relative_accuracy = dict.fromkeys(("tiled", "whole"), 1.0)
    local.make_reducer(prepared, plan, lateness=False)
    assert handed["substreams"] == local.substream_models(prepared, plan)
    assert set(handed["substreams"]) == {(a.stream, a.detector) for a in plan.assignments}


def test_a_detector_s_relative_accuracy_is_its_best_over_the_best_of_the_pool(prepared, plan, monkeypatch):
    """The paper's p_det_rel, and what the reducer is handed of it."""
    good, poor = prepared.pool.detectors
    points = tuple(p.model_copy(update={"accuracy": p.accuracy / 4.0}) for p in poor.accuracy)
    poor = poor.model_copy(update={"accuracy": points})
    prepared.pool = prepared.pool.model_copy(update={"detectors": (good, poor)})
    prepared.relative_accuracy = PreparedMission.relative_accuracy.fget(prepared)
    assert prepared.relative_accuracy == {good.id: 1.0, poor.id: pytest.approx(0.25)}
    handed = []
    monkeypatch.setattr(local, "Fuser", lambda *given, **_: handed.extend(given))
    monkeypatch.setattr(local, "Sequencer", lambda *_: None)
    prepared.mission = SimpleNamespace(
        processing=prepared.mission.processing,
        fusion=SimpleNamespace(lateness=1.0, replay=60.0, replay_results=9),
    )
    prepared.terrain, prepared.cameras, prepared.streams, prepared.onto = None, {}, (), None
    local.make_reducer(prepared, plan, lateness=False)
    assert handed[3] == {a.detector: prepared.relative_accuracy[a.pool_detector] for a in plan.assignments}
    worth = local.substream_models(prepared, plan)
    top = {good.id: 1.0, poor.id: 0.25}
    for a in plan.assignments:
        assert worth[a.stream, a.detector].lowers <= top[a.pool_detector] + 1e-12


def test_a_machine_opens_its_detectors_with_the_calibration_of_the_plan_s_bitrate_and_codec(
    prepared, plan, monkeypatch
):
    seen = []
    monkeypatch.setattr(
        machine, "open_pool_detector", lambda row, layers, setup: seen.append(row.calibration)
    )
    actor = MachineActor("m", "127.0.0.1", "h265")
    detector = PoolDetector.model_validate(row("d", "small", operating_points=MEASURED))
    expected = []
    for codec in ("", "h264"):
        for a in plan.assignments:
            actor._opened(replace(a, codec=codec), detector, LAYERS)
            expected.append(SCALES[codec or "h265", a.bitrate_bps])
    assert [c.scale for c in seen] == expected


def test_a_substream_that_is_opened_later_is_worth_what_it_is_at_its_own_bitrate(prepared, plan, monkeypatch):
    learned = {}

    class Learns:
        def __init__(self, *_, **named):
            assert named["substreams"] is None or not named["substreams"]

        def learn(self, stream, detector, epoch, relative, worth):
            learned[stream, detector, epoch] = relative, worth

    monkeypatch.setattr(local, "Fuser", Learns)
    prepared.mission = SimpleNamespace(
        processing=prepared.mission.processing,
        fusion=SimpleNamespace(lateness=1.0, replay=60.0, replay_results=9),
    )
    prepared.terrain, prepared.cameras, prepared.streams, prepared.onto = None, {}, (), None
    prepared.relative_accuracy = {"tiled": 0.5, "whole": 1.0}
    stage = local.make_reducer(prepared, replace(plan, assignments=()), lateness=True)
    for epoch, a in enumerate(plan.assignments, 3):
        stage.open_again(a.stream, a.detector, epoch, assignment_to_json(a))
    assert learned == {
        (a.stream, a.detector, epoch): (
            prepared.relative_accuracy[a.pool_detector],
            local.substream_worth(prepared, a),
        )
        for epoch, a in enumerate(plan.assignments, 3)
    }
    assert stage.open == learned.keys()
