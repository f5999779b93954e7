# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The argument `cache`: transforms of recordings as frozen files, which later calls map."""

import errno
import os
import pickle
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from making_bags import S, drive, write_db3, write_folder, write_mcap
from pickles_and_copies import held
from robot_of_all_joints import ARM, NAMES, joint_state
from times_and_transforms import transform

from tf2_py.atomic_files import whole_file
from tf2_ros import Buffer
from tf2_ros_tools import bag
from tf2_ros_tools.programs.tf2_bag import PARSER
from tf2_ros_tools.programs.tf2_bag import bag as tf2_bag
from tf2_ros_tools.recordings import bag_cache, bag_loader


@pytest.fixture
def path(tmp_path):
    return write_mcap(tmp_path / "drive.mcap", [*drive(20), joint_state(100 * S, NAMES, [0.1, 0.2, 0.3])])


@pytest.fixture
def cache(tmp_path):
    return tmp_path / "new" / "cache"


def files(folder):
    return sorted(folder.iterdir())


def test_the_next_call_maps_the_file_of_the_first(path, cache, monkeypatch):
    loaded, first = bag.load(path), bag.load(path, cache=cache)
    [made] = files(cache)
    # It would read the recording.
    monkeypatch.setattr("tf2_ros_tools.recordings.bag_loader.fill_buffer", None)
    second = bag.load(path, cache=str(cache))
    for one in (first, second):
        assert held(one) == held(loaded)
        assert one.clock is None
        assert len(pickle.dumps(one)) < 1000
        one.set_transform(transform("camera", "mark", 101), "x")
    assert files(cache) == [made]


def test_a_changed_recording_is_read_again_and_its_old_file_deleted(path, cache):
    old = bag.load(path, cache=cache)
    [before] = files(cache)
    write_mcap(path, drive(30))
    new = bag.load(path, cache=cache)
    [after] = files(cache)
    assert before != after
    assert held(new) == held(bag.load(path))
    assert old.frames()["base"].count < new.frames()["base"].count


def test_an_old_file_that_cannot_be_deleted_remains(path, cache):
    """Another user may have made it, in a folder in which only owners delete."""
    bag.load(path, cache=cache)
    [before] = files(cache)
    before.unlink()
    before.mkdir()  # which nobody can unlink
    write_mcap(path, drive(30))
    assert held(bag.load(path, cache=cache)) == held(bag.load(path))
    assert before in files(cache)


def replaced_by_one_of_equal_size_and_time(path, sizes):
    other = write_db3(path.with_name("other.db3"), drive(20, speed=2.0))
    assert other.stat().st_size == sizes
    os.utime(other, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns))
    os.replace(other, path)


def changed_in_place_with_the_time_set_back(path, _):
    before = path.stat()
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("update messages set data = (select data from messages where id = 3) where id = 9")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.mark.parametrize(
    "change", [replaced_by_one_of_equal_size_and_time, changed_in_place_with_the_time_set_back]
)
def test_size_and_time_do_not_hide_a_change(change, tmp_path, cache):
    path = write_db3(tmp_path / "run.db3", drive(20))
    old, facts = bag.load(path, cache=cache), path.stat()
    change(path, facts.st_size)
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (facts.st_size, facts.st_mtime_ns)
    new = bag.load(path)
    assert held(new) != held(old)
    assert held(bag.load(path, cache=cache)) == held(new)
    assert len(files(cache)) == 1


def unmerged(path):
    """A connection that has made a change in a second file beside the database."""
    connection = sqlite3.connect(path)
    connection.execute("pragma journal_mode = wal")
    connection.execute("delete from messages where id > 12")
    connection.commit()
    return closing(connection)


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.filterwarnings("ignore:.*metadata.yaml counts")  # what is merged later deletes messages
def test_what_is_not_merged_into_a_database_is_missed_with_a_cache_too(whole, tmp_path, cache):
    folder = write_folder(tmp_path / "run", drive(20), "sqlite3")
    path = folder if whole else folder / "run.db3"
    with closing(sqlite3.connect(folder / "run.db3")) as database:
        database.execute("pragma journal_mode = wal")  # as rosbag2's preset "resilient" does
    before = bag.load(path, cache=cache)
    with unmerged(folder / "run.db3"):
        for options in ({}, {"cache": cache}):
            with pytest.raises(bag.BagError, match="run.db3 is incomplete without run.db3-wal: .* merges it"):
                bag.load(path, **options)
    after = bag.load(path, cache=cache)
    assert after.frames()["base"].count < before.frames()["base"].count


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("cached", [False, True])
@pytest.mark.filterwarnings("ignore:.*metadata.yaml counts")  # what is merged later deletes messages
def test_what_is_not_merged_beside_the_target_of_a_link_is_missed(whole, cached, tmp_path, cache):
    folder = write_folder(tmp_path / "run", drive(20), "sqlite3")
    (tmp_path / "kept").mkdir()
    kept = (folder / "run.db3").rename(tmp_path / "kept" / "run.db3")
    (folder / "run.db3").symlink_to(kept)
    path, options = folder if whole else folder / "run.db3", {"cache": cache} if cached else {}
    bag.load(path, **options)
    with unmerged(kept):
        with pytest.raises(bag.BagError, match="run.db3 is incomplete without run.db3-wal: .* merges it"):
            bag.load(path, **options)
    assert held(bag.load(path, **options)) == held(bag.load(kept))


def test_the_target_of_a_link_may_have_any_name(path, tmp_path, cache, monkeypatch):
    """As in a store whose files are named by what they contain."""
    target = path.rename(tmp_path / "d41d8cd98f00")
    path.symlink_to(target)
    first = bag.load(path, cache=cache)
    assert held(first) == held(bag.load(path))
    monkeypatch.setattr("tf2_ros_tools.recordings.bag_loader.fill_buffer", None)
    assert held(bag.load(path, cache=cache)) == held(first)


def test_a_link_that_is_moved_meanwhile_has_no_file(path, tmp_path, cache, monkeypatch):
    target, other = path.rename(tmp_path / "first"), write_mcap(tmp_path / "other.mcap", drive(30))
    path.symlink_to(target)
    read = bag_loader.fill_buffer

    def move_and_read(*arguments, **options):
        path.unlink()
        path.symlink_to(other)
        return read(*arguments, **options)

    with monkeypatch.context() as moving:
        moving.setattr("tf2_ros_tools.recordings.bag_loader.fill_buffer", move_and_read)
        bag.load(path, cache=cache)
    assert not cache.exists()


def test_a_folder_that_cannot_be_listed(path, cache, monkeypatch):
    def refuse(folder):
        raise PermissionError(errno.EACCES, "Permission denied", folder)

    bag.load(path, cache=cache)
    write_mcap(path, drive(30))
    monkeypatch.setattr("os.listdir", refuse)
    assert held(bag.load(path, cache=cache)) == held(bag.load(path))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_the_folder_of_a_recording_may_be_that_of_its_file(storage, tmp_path, monkeypatch):
    folder = write_folder(tmp_path / "run", drive(20), storage)
    first = bag.load(folder, cache=folder)
    listed = files(folder)
    monkeypatch.setattr("tf2_ros_tools.recordings.bag_loader.fill_buffer", None)
    with whole_file(folder / "of another thread"):
        assert held(bag.load(folder, cache=folder)) == held(first)
        assert len(files(folder)) == len(listed) + 1


def test_other_files_of_the_folder_may_vanish_meanwhile(tmp_path, cache, monkeypatch):
    folder = write_folder(tmp_path / "run", drive(20), "mcap")
    other = folder / "upload.part"
    other.touch()
    state_of_file = bag_cache._state_of_file

    def state(path):
        other.unlink(missing_ok=True)
        return state_of_file(path)

    monkeypatch.setattr(bag_cache, "_state_of_file", state)
    assert held(bag.load(folder, cache=cache)) == held(bag.load(folder))


def test_names_may_have_the_longest_length(path, tmp_path, cache):
    """Longer by one of SQLite's endings, they would name no file."""
    longest = path.rename(path.with_name(f"{'x' * 250}.mcap"))
    folder = write_folder(tmp_path / "run", drive(20), "mcap")
    (folder / ("x" * 255)).touch()
    for one in (longest, folder):
        assert held(bag.load(one, cache=cache)) == held(bag.load(one))


def test_a_recording_may_have_hidden_files(tmp_path, cache):
    folder = write_folder(tmp_path / "run", drive(20), "mcap")
    (folder / "run.mcap").rename(folder / ".run.mcap")
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("run.mcap", ".run.mcap"))
    before = bag.load(folder, cache=cache)
    write_mcap(folder / ".run.mcap", drive(30))
    after = bag.load(folder, cache=cache)
    assert after.frames()["base"].count > before.frames()["base"].count


@pytest.mark.parametrize(
    "options",
    [
        {"cache_time": 1.0},
        {"topics": ["/tf_static"]},
        {"topics": {"/tf": "robot/"}},
        {"start": 101 * S},
        {"urdf": ARM},
    ],
    ids=str,
)
def test_other_arguments_have_files_of_their_own(options, path, cache):
    bag.load(path, cache=cache)
    for _ in range(2):
        assert held(bag.load(path, cache=cache, **options)) == held(bag.load(path, **options))
    assert len(files(cache)) == 2


def test_a_limit_of_one_process_is_not_that_of_the_next(path, cache, monkeypatch):
    with monkeypatch.context() as limited:
        limited.setenv("TF2_ROS_CYTHON_MAX_FRAMES", "2")
        assert len(bag.load(path, cache=cache).frames()) == 2
    assert held(bag.load(path, cache=cache)) == held(bag.load(path))


def test_a_damaged_file_is_made_again(path, cache):
    bag.load(path, cache=cache)
    [made] = files(cache)
    whole = made.read_bytes()
    made.unlink()
    made.write_bytes(whole[:-1])
    assert held(bag.load(path, cache=cache)) == held(bag.load(path))
    assert made.read_bytes() == whole


def test_a_recording_that_does_not_exist_has_no_file(tmp_path, cache):
    with pytest.raises(FileNotFoundError, match=r"the recording does not exist: .*gone.mcap"):
        bag.load(tmp_path / "gone.mcap", cache=cache)
    assert not cache.exists()


def test_the_command_writes_a_file_that_opens(path, tmp_path, capsys):
    frozen = tmp_path / "drive.tf2"
    assert tf2_bag(PARSER.read(["tf2_bag", "freeze", str(path), "-o", str(frozen)])) == 0
    assert Path(capsys.readouterr().out.strip()) == frozen
    assert held(Buffer.open(frozen)) == held(bag.load(path))


def test_no_folder_is_refused(path):
    with pytest.raises(ValueError, match="cache: expected a folder, got ''"):
        bag.load(path, cache="")
