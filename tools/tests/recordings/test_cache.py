"""The argument `cache`: transforms of recordings as frozen files, which later calls map."""

import pickle
from pathlib import Path

import pytest
from making import transform
from making_bags import S, drive, write_mcap
from robots import ARM, NAMES, joint_state
from travelling import held

from tf2_ros import Buffer
from tf2_ros_tools import bag
from tf2_ros_tools.programs.tf2_bag import PARSER
from tf2_ros_tools.programs.tf2_bag import bag as tf2_bag

pytestmark = pytest.mark.ours


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
    monkeypatch.setattr("tf2_ros_tools.loading.fill_buffer", None)  # which would read the recording
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


def test_a_damaged_file_is_made_again(path, cache):
    bag.load(path, cache=cache)
    [made] = files(cache)
    whole = made.read_bytes()
    made.unlink()
    made.write_bytes(whole[:-1])
    assert held(bag.load(path, cache=cache)) == held(bag.load(path))
    assert made.read_bytes() == whole


def test_a_recording_that_does_not_exist_has_no_file(tmp_path, cache):
    with pytest.raises(FileNotFoundError, match=r"gone.mcap"):
        bag.load(tmp_path / "gone.mcap", cache=cache)
    assert not cache.exists()


def test_the_command_writes_a_file_that_opens(path, tmp_path, capsys):
    frozen = tmp_path / "drive.tf2"
    assert tf2_bag(PARSER.read(["tf2_bag", "freeze", str(path), "-o", str(frozen)])) == 0
    assert Path(capsys.readouterr().out.strip()) == frozen
    assert held(Buffer.open(frozen)) == held(bag.load(path))


@pytest.mark.long("needs pyarrow")
@pytest.mark.parametrize("workers", [1, 2])
def test_map_recordings_freezes_what_load_opens(workers, path, cache, tmp_path):
    pytest.importorskip("pyarrow")
    pytest.importorskip("distributed")
    other = write_mcap(tmp_path / "other.mcap", drive(10))
    ends = ([path, other], "map", "base", tmp_path / "tables")
    first = bag.map_recordings(*ends, workers=workers)
    assert len(first.done) == 2
    assert not cache.exists()
    # A table without the file is not enough, and both together are.
    assert len(bag.map_recordings(*ends, workers=workers, cache=cache).done) == 2
    assert len(bag.map_recordings(*ends, workers=workers, cache=cache).skipped) == 2
    made = files(cache)
    assert len(made) == 2
    for one in (path, other):
        assert held(bag.load(one, cache=cache)) == held(bag.load(one))
    assert files(cache) == made
