"""A journal holds what was committed, says what it cut off, and goes on."""

from contextlib import suppress
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.storage.disk import LOCAL_DISK
from pipeline.storage.journal import FIRST, recover, require_identity
from pipeline.storage.journal_segment import FIRST_LINE, Identity
from tests.memory_disk import CrashError, MemoryDisk

HERE, OURS = Path("/run/journal"), Identity("results 1", "a mission")
RECORDS = [bytes([i]) * (1 + 7 * i) for i in range(12)]


def opened(disk, start=FIRST, identity=OURS):
    return recover(disk, HERE, identity, start)


def committing(disk, records, error, journal=None, every=1):
    """How many records are committed before an error comes."""
    committed = 0
    with suppress(error):
        journal = journal or opened(disk)[0]
        for count, record in enumerate(records, 1):
            journal.append(record)
            if count % every == 0:
                journal.commit()
                committed = count
    return committed


def written(disk, records=RECORDS, every=3):
    journal, _ = opened(disk)
    for count, record in enumerate(records, 1):
        journal.append(record)
        if count % every == 0:
            journal.commit()
    journal.commit()
    return journal


def test_what_was_committed_is_there_again(tmp_path):
    for disk, folder in ((MemoryDisk(), HERE), (LOCAL_DISK, tmp_path / "a" / "journal")):
        journal, new = recover(disk, folder, OURS)
        assert (new.records, new.cut) == ((), ())
        journal.append(b"one")
        journal.append(b"")
        journal.commit()
        journal.append(b"never committed")
        journal, again = recover(disk, folder, OURS)
        assert (again.records, again.cut) == ((b"one", b""), ())
        journal.append(b"two")
        journal.close()
        assert recover(disk, folder, OURS)[1].records == (b"one", b"", b"two")


def test_records_of_one_commit_share_one_sync():
    disk = MemoryDisk()
    journal, _ = opened(disk)
    before = disk.steps
    for record in RECORDS:
        journal.append(record)
    journal.commit()
    assert disk.steps - before == 2  # a write and a sync


@pytest.mark.parametrize("when", ["before", "during", "after"])
@pytest.mark.parametrize("power_cut", [False, True])
def test_killed_at_any_step_it_holds_what_was_committed_and_a_prefix_of_the_rest(when, power_cut):
    steps = MemoryDisk()
    written(steps)
    for crash_at in range(1, steps.steps + 1):
        disk = MemoryDisk(crash_at, when)
        committed = committing(disk, RECORDS, CrashError, every=3)
        for seed in range(6):
            after = disk.after_crash(power_cut, seed)
            journal, found = opened(after)
            assert list(found.records) == RECORDS[: len(found.records)]
            assert len(found.records) >= committed
            rest = RECORDS[len(found.records) :]
            for record in rest:
                journal.append(record)
            journal.commit()
            assert list(opened(after.after_crash(power_cut=True, seed=seed))[1].records) == RECORDS


def test_every_flipped_bit_and_every_cut_keeps_what_came_before_and_is_said():
    disk = MemoryDisk()
    written(disk, RECORDS[:5])
    path = HERE / "journal-000001.log"
    whole = disk.read(path)
    for at in range(len(whole)):
        for harm in ("flip", "cut"):
            damaged = disk.copy()
            damaged.damage(path, at, 1 << (at % 8)) if harm == "flip" else damaged.cut(path, at)
            journal, found = opened(damaged)
            assert list(found.records) == RECORDS[: len(found.records)]
            assert len(found.records) < 5
            # cut between two records nothing is missing that anybody could see
            clean = harm == "cut" and damaged.copy().names(HERE) and not found.cut
            assert found.cut or clean
            if found.cut:
                assert "journal-000001.log: cut off" in found.cut[0]
            journal.append(b"goes on")
            journal.commit()
            again = opened(damaged)[1]
            assert again.records == (*found.records, b"goes on")
            assert again.cut == ()


def test_whole_records_in_other_places_are_not_taken():
    disk, path = MemoryDisk(), HERE / "journal-000001.log"
    written(disk, [b"first", b"other", b"third"])
    whole = disk.read(path)
    size = len(b"first") + 20
    places = [whole[-3 * size : -2 * size], whole[-2 * size : -size], whole[-size:]]
    for order, kept in (((1, 0, 2), 0), ((0, 2, 1), 1), ((0, 0, 1), 1), ((0, 2), 1)):
        file = disk.create(path)
        file.write(whole[: -3 * size] + b"".join(places[i] for i in order))
        file.sync()
        found = opened(disk.copy())[1]
        assert found.records == (b"first", b"other")[:kept]
        assert found.cut


def test_what_stands_behind_damage_in_an_earlier_segment_is_not_read():
    disk = MemoryDisk()
    journal = written(disk, RECORDS[:4])
    journal.rotate()
    journal.append(b"later")
    journal.commit()
    size = len(disk.read(HERE / "journal-000001.log"))
    disk.damage(HERE / "journal-000001.log", size - 1, 1)
    found = opened(disk)[1]
    assert list(found.records) == RECORDS[:3]
    assert ["journal-000001" in found.cut[0], "journal-000002" in found.cut[1]] == [True, True]


def test_an_old_segment_behind_a_cut_does_not_come_back():
    """The cut is on the disk, the removal of the segment after it is not: a crash between the two."""
    disk = MemoryDisk()
    journal = written(disk, RECORDS[:4])
    journal.rotate()
    journal.append(b"later")
    journal.commit()
    old = disk.read(HERE / "journal-000002.log")
    disk.cut(HERE / "journal-000001.log", len(disk.read(HERE / "journal-000001.log")) - 1)
    opened(disk)
    file = disk.create(HERE / "journal-000002.log")
    file.write(old)
    file.sync()
    assert list(opened(disk)[1].records) == RECORDS[:3]


def test_a_checkpoint_makes_earlier_segments_superfluous():
    disk = MemoryDisk()
    journal = written(disk, RECORDS[:4])
    position = journal.rotate()
    journal.append(b"after")
    journal.commit()
    journal.forget(position.segment)
    assert disk.names(HERE) == ["journal-000002.log"]
    assert opened(disk, position)[1].records == (b"after",)
    lost = opened(disk.copy())[1]  # without its checkpoint what is left says nothing
    assert lost.records == ()
    assert "it does not follow" in lost.cut[0]


def test_a_full_disk_loses_nothing_that_was_committed_and_writing_can_begin_again():
    for full_at in range(6, 30):
        disk = MemoryDisk(full_at=full_at)
        journal, _ = opened(disk)
        committed = (RECORDS * 5)[: committing(disk, RECORDS * 5, OSError, journal)]
        assert len(committed) < 60
        disk.room()
        assert list(opened(disk.copy())[1].records) == committed
        position = journal.begin_again()
        journal.append(b"goes on")
        journal.commit()
        assert opened(disk.copy(), position)[1].records == (b"goes on",)
        both = opened(disk)[1]  # without the checkpoint: there is a gap, and it is said
        assert list(both.records) == committed
        assert both.cut


@pytest.mark.parametrize(
    ("identity", "text"),
    [
        (Identity("results 1", "another"), "another mission"),
        (Identity("results 2", "a mission"), "results 1"),
    ],
)
def test_another_missions_journal_is_refused(identity, text):
    disk = MemoryDisk()
    written(disk)
    for ask in (opened, lambda d, identity: require_identity(d, HERE, identity)):
        with pytest.raises(InputError, match=text):
            ask(disk, identity=identity)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (FIRST_LINE.replace(b"1", b"7") + b"whatever", "version 7"),
        (b"searchlight journal 12\n" + bytes(range(200, 240)), "version 12"),
        (b"<!doctype html><html lang='en'>", "no journal"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "no journal"),
    ],
)
def test_what_is_no_journal_of_this_version_is_refused_and_left_as_it_is(data, text):
    disk = MemoryDisk()
    file = disk.create(HERE / "journal-000001.log")
    file.write(data)
    file.sync()
    with pytest.raises(InputError, match=text):
        opened(disk)
    assert disk.read(HERE / "journal-000001.log") == data
