"""Killed before, during or after any write, sync, rename or removal, a reducer goes on where it was.

The law: what it knows then is what a reducer knows that was given a prefix of what this one was sent, and the prefix
holds everything that was acknowledged. When everything is sent again, the map is that of a reducer that never died.
"""

from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.fusion import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.map_file import map_records
from pipeline.fusion.sequencer import Sequencer
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.surfaces import plane
from pipeline.messages import CameraPose, Detections, Dropped, EndOfStream
from pipeline.mission.checkpoint import state_records
from pipeline.mission.durable_reducer import DurableReducer, JournalParams
from pipeline.mission.stages.reducer import ReducerStage
from tests.memory_disk import CrashError, MemoryDisk

HERE = Path("/run/journal")
SUBSTREAMS = (("a", "d"), ("a", "e"), ("b", "d"))
CAMERA = Camera(256, 144, 225.0, 225.0, 128.0, 72.0)
TERRAIN = plane(LocalFrame(47.0, 8.0), -20.0, -20.0, 20.0, 20.0, 0.5, 0.0)
LATENESS_NS = 40
#: three commits to a checkpoint, a few messages to a commit
PARAMS = JournalParams(commit_s=0.05, checkpoint_s=0.17)
MESSAGE_S = 0.018


def _params():
    sides = {f"{side}_{end}" for side in ("width", "height") for end in ("min", "max")}
    return Fusion.model_validate(
        {
            "cell_size": {"meters": 0.5},
            "positive_max": 0.4,
            "negative_max": 0.1,
            "tukey_alpha": 0.5,
            "significant_point": "bottom_center",
            "object_size": {s: {"meters": 0.1 if s.endswith("min") else 4.0} for s in sides},
            "threshold": 0.7,
            "cluster_distance": {"meters": 1.5},
            "lateness": {"seconds": 2.0},
        }
    )


FUSION = _params()


def _stage():
    fuser = Fuser(TERRAIN, FUSION, {"a": CAMERA, "b": CAMERA}, {"d": 1.0, "e": 0.7})
    return ReducerStage(fuser, Sequencer(SUBSTREAMS, LATENESS_NS), SUBSTREAMS)


def _messages(seed=5, each=13):
    """Of all substreams, out of order within the lateness; some dropped, all ended, one of a second epoch."""
    rng, sent = np.random.default_rng(seed), []
    for name, substream in enumerate(SUBSTREAMS):
        for i in range(each):
            time_ns = 10 * i + name
            if i == 4:
                sent.append((time_ns, Dropped(*substream, i, time_ns, "machine_busy", 0, i)))
                continue
            attitude = enu_from_camera(rng.uniform(0.0, 6.0), -1.0, 0.0)
            pose = CameraPose(np.array([*rng.uniform(-8.0, 8.0, 2), 9.0]), attitude)
            corner = rng.uniform(20.0, 90.0, (1, 2))
            box = np.concatenate([corner, corner + np.array([14.0, 30.0])], axis=1)
            found, epoch = rng.uniform(0.5, 1.0, 1), int(i >= 9)
            result = Detections(
                *substream, i, time_ns, pose, box, found, np.zeros(1, dtype=np.int64), epoch=epoch,
                sequence=i - 9 if epoch else i,
            )  # fmt: skip
            sent.append((time_ns + int(rng.integers(LATENESS_NS // 2)), result))
    ends = [EndOfStream(*substream, 1, each - 9) for substream in SUBSTREAMS]
    return [message for _, message in sorted(sent, key=lambda pair: pair[0])] + ends


MESSAGES = _messages()


def _known(stage):
    return sha256(b"".join(state_records(stage))).hexdigest()


def _map(stage):
    return [record for voxel_map in stage.fuser.maps.values() for record in map_records(voxel_map)]


@pytest.fixture(scope="module")
def prefixes():
    """What a reducer knows after so many messages, -> how many."""
    stage, known = _stage(), {}
    known[_known(stage)] = 0
    for count, message in enumerate(MESSAGES, 1):
        stage.push(message)
        known[_known(stage)] = count
    return known


@pytest.fixture(scope="module")
def whole():
    stage = _stage()
    for message in MESSAGES:
        stage.push(message)
    stage.finish()
    return _map(stage)


def _run(disk, acknowledged, messages=MESSAGES, fingerprint="mine"):
    """Send messages to a reducer on a disk; acknowledged: by (substream, epoch), filled as long as it lives."""
    reducer, now_s = DurableReducer(_stage(), HERE, fingerprint, 0.0, PARAMS, disk), 0.0
    for message in messages:
        now_s += MESSAGE_S
        if isinstance(message, tuple):
            name, *arguments = message
            getattr(reducer, name)(*arguments)
            continue
        reducer.push(message, now_s)
        for said in reducer.tick(now_s):
            acknowledged[said.stream, said.detector, said.epoch] = said
    for said in reducer.commit():
        acknowledged[said.stream, said.detector, said.epoch] = said
    return reducer


def _acknowledged_at(acknowledged):
    """How long a prefix holds all that was acknowledged."""
    held = [
        count
        for count, m in enumerate(MESSAGES, 1)
        if (m.stream, m.detector, m.epoch) in acknowledged
        and m.sequence in acknowledged[m.stream, m.detector, m.epoch]
    ]
    return max(held, default=0)


def _require_law(after, acknowledged, prefixes, whole):
    reducer = DurableReducer(_stage(), HERE, "mine", 0.0, PARAMS, after)
    known = _known(reducer.stage)
    assert known in prefixes, "a state that no prefix of what was sent makes"
    assert prefixes[known] >= _acknowledged_at(acknowledged)
    for message in MESSAGES[: prefixes[known]]:
        assert reducer.holds(message)
    now_s = 0.0
    for message in MESSAGES:
        now_s += MESSAGE_S
        reducer.push(message, now_s)
        reducer.tick(now_s)
    assert sum(reducer.repeated.values()) == prefixes[known]
    assert _known(reducer.stage) == next(k for k, count in prefixes.items() if count == len(MESSAGES))
    reducer.finish()
    assert _map(reducer.stage) == whole
    assert DurableReducer(_stage(), HERE, "mine", 0.0, PARAMS, after.copy()).recovered == len(MESSAGES)
    for said in reducer.acknowledged:
        assert said.gaps == ()


def _steps():
    disk = MemoryDisk()
    _run(disk, {})
    return disk.steps


def test_there_are_enough_crash_points_and_checkpoints_between_them():
    disk = MemoryDisk()
    reducer = _run(disk, {})
    assert 3 * disk.steps >= 200
    assert sum(name.startswith("checkpoint") for name in disk.names(HERE)) == 2
    assert "journal-000001.log" not in disk.names(HERE)
    assert _acknowledged_at({(a.stream, a.detector, a.epoch): a for a in reducer.acknowledged}) == len(
        MESSAGES
    )


def _require_law_after(crash_at, when, power_cut, prefixes, whole):
    disk, acknowledged = MemoryDisk(crash_at, when), {}
    with suppress(CrashError):
        _run(disk, acknowledged)
    _require_law(disk.after_crash(power_cut, seed=crash_at), acknowledged, prefixes, whole)


@pytest.mark.parametrize("when", ["before", "during", "after"])
def test_killed_or_cut_from_power_at_any_step(when, prefixes, whole):
    for crash_at in range(1, _steps() + 1):
        power_cut = (crash_at + len(when)) % 2 == 0
        _require_law_after(crash_at, when, power_cut, prefixes, whole)


def test_one_checkpoint_is_enough_if_the_disk_keeps_what_it_has(prefixes, whole, monkeypatch):
    """Its name is on the disk before what it makes superfluous is removed."""
    monkeypatch.setattr(f"{__name__}.PARAMS", JournalParams(PARAMS.commit_s, PARAMS.checkpoint_s, 1))
    for crash_at in range(10, _steps() + 1):
        _require_law_after(crash_at, "after", True, prefixes, whole)


@pytest.mark.slow
@pytest.mark.parametrize("when", ["before", "during", "after"])
def test_killed_and_cut_from_power_at_any_step(when, prefixes, whole):
    for crash_at in range(1, _steps() + 1):
        for power_cut in (False, True):
            _require_law_after(crash_at, when, power_cut, prefixes, whole)


def test_killed_again_while_it_recovers(prefixes, whole):
    rng = np.random.default_rng(3)
    for _ in range(15):
        disk, acknowledged = MemoryDisk(int(rng.integers(20, _steps())), "during"), {}
        with suppress(CrashError):
            _run(disk, acknowledged)
        for _ in range(3):
            disk = disk.after_crash(power_cut=bool(rng.integers(2)), seed=int(rng.integers(1 << 30)))
            disk._crash_at, disk._when = int(rng.integers(1, 30)), "before"
            with suppress(CrashError):
                _run(disk, acknowledged)
        disk = disk.after_crash(power_cut=True, seed=int(rng.integers(1 << 30)))
        _require_law(disk, acknowledged, prefixes, whole)


def test_a_torn_or_flipped_tail_of_the_journal_costs_what_stands_behind_it_and_is_said(prefixes, whole):
    disk = MemoryDisk()
    _run(disk, {}, MESSAGES[:26])
    newest = max(name for name in disk.names(HERE) if name.startswith("journal"))
    data, checkpointed = (
        disk.read(HERE / newest),
        DurableReducer(_stage(), HERE, "mine", 0.0, PARAMS, disk.copy()),
    )
    tail = len(data) // 2
    for at in range(tail, len(data), max(1, tail // 20)):
        for flip in (True, False):
            damaged = disk.copy()
            damaged.damage(HERE / newest, at, 1 << (at % 8)) if flip else damaged.cut(HERE / newest, at)
            reducer = DurableReducer(_stage(), HERE, "mine", 0.0, PARAMS, damaged.copy())
            assert prefixes[_known(reducer.stage)] < prefixes[_known(checkpointed.stage)]
            if flip:
                assert f"{newest}: cut off" in reducer.cut[0]
            _require_law(damaged, {}, prefixes, whole)


def test_a_damaged_checkpoint_is_said_and_the_one_before_it_is_used(prefixes, whole):
    disk = MemoryDisk()
    before = _run(disk, {})
    newest = max(name for name in disk.names(HERE) if name.startswith("checkpoint"))
    for at in range(0, len(disk.read(HERE / newest)), len(disk.read(HERE / newest)) // 25):
        damaged = disk.copy()
        damaged.damage(HERE / newest, at, 1 << (at % 8))
        reducer = DurableReducer(_stage(), HERE, "mine", 0.0, PARAMS, damaged)
        assert newest in reducer.cut[0]
        assert newest not in damaged.names(HERE)  # nor counted among those that are kept
        assert _known(reducer.stage) == _known(before.stage)


@pytest.mark.parametrize("full_at", range(12, 60, 5))
def test_a_full_disk_loses_nothing_acknowledged_and_the_map_goes_on(full_at, prefixes, whole):
    disk, acknowledged = MemoryDisk(full_at=full_at), {}
    try:
        reducer = _run(disk, acknowledged)
    except OSError:  # full before anything could be said
        assert acknowledged == {}
        return
    reducer.stage.finish()
    assert _map(reducer.stage) == whole
    assert reducer.trouble is not None
    assert "No space left" in reducer.trouble
    killed = disk.after_crash(power_cut=True, seed=full_at)
    killed.room()
    _require_law(killed, acknowledged, prefixes, whole)


def test_when_there_is_room_again_a_checkpoint_holds_everything(prefixes, whole):
    disk = MemoryDisk(full_at=30)
    reducer, now_s = DurableReducer(_stage(), HERE, "mine", 0.0, PARAMS, disk), 0.0
    for count, message in enumerate(MESSAGES):
        now_s += MESSAGE_S
        if count == 20:
            assert reducer.trouble is not None
            disk.room()
        reducer.push(message, now_s)
        reducer.tick(now_s)
    reducer.commit()
    assert reducer.trouble is None
    acknowledged = {(a.stream, a.detector, a.epoch): a for a in reducer.acknowledged}
    assert _acknowledged_at(acknowledged) == len(MESSAGES)
    _require_law(disk.after_crash(power_cut=True, seed=1), acknowledged, prefixes, whole)


def test_what_was_opened_and_closed_while_it_ran_is_so_again():
    late = [replace(m, epoch=2, sequence=i, index=90 + i, time_ns=900 + i) for i, m in enumerate(
        m for m in MESSAGES if isinstance(m, Detections) and m.detector == "e"
    )]  # fmt: skip
    sent = [
        *MESSAGES[:20],
        ("open_again", "b", "e", 2),
        ("close", "a", "e", 0, "its machine is gone"),
        *(replace(m, stream="b") for m in late[:5]),
        *MESSAGES[20:30],
        ("close", "b", "e", 2, "a new plan"),
        *MESSAGES[30:],
    ]
    expected = _stage()
    for message in sent:
        if isinstance(message, tuple):
            name, *arguments = message
            getattr(expected, name)(*arguments)
        else:
            expected.push(message)
    for count in (21, 23, 26, 32, 38, len(sent)):
        disk = MemoryDisk()
        _run(disk, {}, sent[:count])
        reducer = DurableReducer(_stage(), HERE, "mine", 0.0, PARAMS, disk.after_crash(True, count))
        once = _stage()
        for message in sent[:count]:
            if isinstance(message, tuple):
                name, *arguments = message
                getattr(once, name)(*arguments)
            else:
                once.push(message)
        assert _known(reducer.stage) == _known(once)
    assert _known(once) == _known(expected)


def test_an_acknowledgement_names_what_did_not_come():
    acknowledged = {}
    _run(MemoryDisk(), acknowledged, [m for m in MESSAGES if m.sequence not in (1, 3)])
    said = acknowledged["a", "d", 0]
    assert (said.end, said.gaps) == (9, ((1, 2), (3, 4)))
    assert [n in said for n in (0, 1, 2, 3, 4, 8, 9)] == [True, False, True, False, True, True, False]
