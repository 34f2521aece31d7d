import numpy as np
import pytest

from pipeline.config.fusion import Fusion
from pipeline.errors import InputError
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.sequencer import Sequencer
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.surfaces import plane
from pipeline.messages import CameraPose, Detections, Dropped, EndOfStream
from pipeline.mission.checkpoint import load_checkpoint, save_checkpoint
from pipeline.mission.stages.reducer import ReducerStage

CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
TERRAIN = plane(LocalFrame(47.0, 8.0), -40.0, -40.0, 40.0, 40.0, 0.5, 0.0)
SUBSTREAMS = (("a", "d"), ("b", "d"))


def _params():
    size = {
        f"{side}_{end}": {"meters": m}
        for side in ("width", "height")
        for end, m in (("min", 0.2), ("max", 2.2))
    }
    return Fusion.model_validate(
        {
            "cell_size": {"meters": 0.5},
            "positive_max": 0.4,
            "negative_max": 0.1,
            "tukey_alpha": 0.5,
            "significant_point": "bottom_center",
            "object_size": size,
            "threshold": 0.7,
            "cluster_distance": {"meters": 1.5},
            "lateness": {"seconds": 2.0},
        }
    )


def _stage(substreams=SUBSTREAMS):
    fuser = Fuser(TERRAIN, _params(), dict.fromkeys("ab", CAMERA), {"d": 1.0})
    return ReducerStage(fuser, Sequencer(substreams, 100), substreams)


def _result(stream, time_ns, box=(487.0, 218.0, 537.0, 288.0)):
    pose = CameraPose(np.array([0.1, -0.1, 15.0]), enu_from_camera(0.0, np.deg2rad(-45.0), 0.0))
    one = np.zeros(1, dtype=np.int64)
    return Detections(stream, "d", time_ns, time_ns, pose, np.array([box]), np.array([0.8]), one)


def _busy():
    stage = _stage()
    for message in (
        _result("a", 10),
        _result("b", 5),
        _result("a", 10),
        _result("a", 300, box=(0.5, 218.0, 50.0, 288.0)),
        _result("b", 7),
        Dropped("b", "d", 21, 21, "link full"),
        _result("a", 350, box=(1100.0, 0.0, 1200.0, 10.0)),
        EndOfStream("b", "d"),
    ):
        stage.push(message)
    return stage


def _accounts(stage):
    counted = [(s, stage.frames(s), stage.frames_dropped(s)) for s in "ab"], stage.drops
    return counted, stage.open, stage.received, stage.processed, stage.dropped, stage.detections, stage.hops


def test_a_loaded_reducer_knows_what_the_saved_one_knew(tmp_path):
    saved, loaded = _busy(), _stage()
    save_checkpoint(tmp_path / "state", saved)
    load_checkpoint(tmp_path / "state", loaded)
    assert _accounts(loaded) == _accounts(saved)
    assert loaded.not_taken == saved.not_taken
    assert saved.sequencer.late == {("b", "d"): 1}
    assert loaded.fuser.map.tiles.cells.tobytes() == saved.fuser.map.tiles.cells.tobytes()
    assert [k.order for k in loaded.fuser.looks] == [k.order for k in saved.fuser.looks]
    saved.finish()
    loaded.finish()
    assert loaded.fuser.map.tiles.cells.tobytes() == saved.fuser.map.tiles.cells.tobytes()
    assert loaded.not_taken == saved.not_taken


def test_a_saved_and_loaded_reducer_saves_the_same_file(tmp_path):
    save_checkpoint(tmp_path / "a", _busy())
    loaded = _stage()
    load_checkpoint(tmp_path / "a", loaded)
    save_checkpoint(tmp_path / "b", loaded)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("at", [3, 100, -40])
def test_a_damaged_file_is_refused_and_the_reducer_stays_as_it_was(tmp_path, at):
    save_checkpoint(tmp_path / "state", _busy())
    data = bytearray((tmp_path / "state").read_bytes())
    data[at] ^= 1
    (tmp_path / "state").write_bytes(data)
    stage = _stage()
    with pytest.raises(InputError, match="state: found"):
        load_checkpoint(tmp_path / "state", stage)
    assert not stage.fuser.map.tiles.touched.any()
    assert _accounts(stage) == _accounts(_stage())


def test_the_state_of_another_mission_is_refused(tmp_path):
    save_checkpoint(tmp_path / "state", _busy())
    with pytest.raises(InputError, match="substreams"):
        load_checkpoint(tmp_path / "state", _stage((("a", "d"),)))
