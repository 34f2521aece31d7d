"""In any order, with repetitions, interrupted, by several fusers: the same map, byte for byte."""

import math
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config.fusion import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.map_file import map_records
from pipeline.fusion.replay import ReplayParams
from pipeline.fusion.sequencer import Sequencer
from pipeline.fusion.sharding import merge, shares
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections, EndOfStream
from pipeline.mission.checkpoint import load_checkpoint, save_checkpoint
from pipeline.mission.stages.reducer import ReducerStage

SUBSTREAMS = [("a", "d"), ("a", "e"), ("b", "d")]
CAMERA = Camera(256, 144, 225.0, 225.0, 128.0, 72.0)
LATENESS_NS = 1000


def _terrain():
    """60 m x 104 m, 2 x 3 tiles."""
    north, east = np.arange(300) * 0.2 - 30.0, np.arange(520) * 0.2 - 52.0
    heights = np.sin(north / 5.0)[:, None] + np.cos(east / 3.0)[None]
    return Terrain(LocalFrame(47.0, 8.0), -52.0, -30.0, 0.2, heights.astype(np.float32))


def _params():
    low, high = {"meters": 0.1}, {"meters": 4.0}
    further = {
        "id": 1,
        "name": "boat",
        "significant_point": "center",
        "object_size": {"width_min": low, "width_max": high, "height_min": low, "height_max": high},
    }
    return Fusion.model_validate(
        {
            "cell_size": {"meters": 0.2},
            "positive_max": 0.4,
            "negative_max": 0.3,
            "tukey_alpha": 0.5,
            "significant_point": "bottom_center",
            "object_size": further["object_size"],
            "further_classes": [further],
            "threshold": 0.7,
            "cluster_distance": {"meters": 1.5},
            "lateness": {"seconds": 2.0},
        }
    )


TERRAIN, PARAMS = _terrain(), _params()


def _fuser(owned=None):
    return Fuser(TERRAIN, PARAMS, {"a": CAMERA, "b": CAMERA}, {"d": 1.0, "e": 0.7}, owned=owned)


def _stage(replay_ns=0):
    sequencer = Sequencer(SUBSTREAMS, LATENESS_NS)
    return ReducerStage(_fuser(), sequencer, SUBSTREAMS, replay=ReplayParams(replay_ns))


def _result(rng, substream, index, time_ns):
    east, north = rng.uniform(-50.0, 50.0), rng.uniform(-25.0, 25.0)
    attitude = enu_from_camera(rng.uniform(0.0, 6.0), -math.pi / 4.0, rng.normal() * 0.1)
    pose = CameraPose(np.array([east, north, rng.uniform(-1.0, 9.0)]), attitude)
    corners = rng.uniform(-10.0, 1.0, (2, 2)) + rng.uniform(0.0, 1.0, (2, 2)) * (230.0, 120.0)
    boxes = np.concatenate([corners, corners + rng.uniform(5.0, 50.0, (2, 2))], axis=1)
    return Detections(
        *substream, index, time_ns, pose, boxes, rng.uniform(0.0, 1.05, 2), rng.integers(0, 3, 2)
    )


@st.composite
def results(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    made = []
    for substream in SUBSTREAMS:
        times = draw(st.lists(st.integers(0, 4000), unique=True, max_size=5).map(sorted))
        made += [_result(rng, substream, i, t) for i, t in enumerate(times)]
    return sorted(made, key=lambda result: result.order)


def _knowledge(fuser, processed):
    maps = {name: list(map_records(voxel_map)) for name, voxel_map in fuser.maps.items()}
    looks = [(k.order, k.class_name, k.p, k.intersection_enu.tobytes()) for k in fuser.looks]
    return maps, looks, fuser.refused, fuser.unplaced, fuser.last_ns, processed


def _run(arrived, restarts=(), replay_ns=0, settled=()):
    stage = _stage(replay_ns)
    with tempfile.TemporaryDirectory() as folder:
        for number, message in enumerate(arrived):
            if number in restarts:
                save_checkpoint(Path(folder) / "state", stage)
                stage = _stage(replay_ns)
                load_checkpoint(Path(folder) / "state", stage)
            stage.push(message)
            if number in settled:
                stage.settle()
    for substream in SUBSTREAMS:
        stage.push(EndOfStream(*substream))
    stage.settle()
    return stage


@settings(max_examples=15, deadline=None)
@given(results(), st.data())
def test_any_permutation_within_the_lateness_any_duplication_any_restarts_give_the_same_bytes(sent, data):
    whole = _run(sent)
    delays = data.draw(
        st.lists(st.integers(0, LATENESS_NS - 1), min_size=len(sent), max_size=len(sent)), label="delays"
    )
    arrived = [sent[i] for i in sorted(range(len(sent)), key=lambda i: sent[i].time_ns + delays[i])]
    for _ in range(data.draw(st.integers(0, 4), label="duplicates") if sent else 0):
        first = data.draw(st.integers(0, len(arrived) - 1))
        arrived.insert(data.draw(st.integers(first + 1, len(arrived))), arrived[first])
    restarts = data.draw(st.sets(st.integers(0, len(arrived)), max_size=3), label="restarts")
    stage = _run(arrived, restarts)
    assert not stage.sequencer.late
    assert stage.sequencer.refused.total() == len(arrived) - len(sent)
    assert _knowledge(stage.fuser, stage.processed) == _knowledge(whole.fuser, whole.processed)


@settings(max_examples=30, deadline=None)
@given(results(), st.data())
def test_what_comes_later_than_the_lateness_is_put_in_its_place_within_the_window(sent, data):
    whole = _run(sent)
    replay_ns = data.draw(st.sampled_from([1500, 2500, 4001]), label="window")
    delays = data.draw(st.lists(st.integers(0, replay_ns), min_size=len(sent), max_size=len(sent)))
    arrived = [sent[i] for i in sorted(range(len(sent)), key=lambda i: sent[i].time_ns + delays[i])]
    at = st.sets(st.integers(0, len(arrived)), max_size=3)
    stage = _run(arrived, data.draw(at, label="restarts"), replay_ns, data.draw(at, label="settled"))
    assert not stage.replay.out_of_place
    assert stage.replay.late == stage.sequencer.late
    assert _knowledge(stage.fuser, stage.processed) == _knowledge(whole.fuser, whole.processed)


@settings(max_examples=15, deadline=None)
@given(results(), st.integers(1, 11))
def test_fusers_that_own_tiles_make_the_map_of_one(sent, count):
    one, gathered = _fuser(), _fuser()
    parts = [_fuser(owned) for owned in shares(TERRAIN.shape, count)]
    for result in sent:
        for fuser in (one, *parts):
            fuser.apply(result)
    merge(parts, gathered)
    assert _knowledge(gathered, ()) == _knowledge(one, ())


@given(st.integers(1, 5000), st.integers(1, 5000), st.integers(1, 20))
def test_every_tile_has_one_owner(rows, columns, fusers):
    owned = shares((rows, columns), fusers)
    assert len(owned) == fusers
    assert (np.sum(owned, axis=0) == 1).all()
