"""evo, which looks up the transforms of recordings by `tf2_py`: by this one, compared with our own ways."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from making_bags import S, drive, write_folder, write_mcap, write_ros1
from numpy.testing import assert_allclose
from processes import DEADLINE_S, ended

import tf2_py
import tf2_ros_tools.bag

pytestmark = [
    pytest.mark.ours,
    pytest.mark.long("needs evo"),
    pytest.mark.skipif(sys.version_info < (3, 11), reason="evo needs Python 3.11"),
]

BEGIN = 1_700_000_000 * S
LOOKUPS_HZ = 10  # evo's setting tf_cache_lookup_frequency

# The formats that evo reads, by its names for them.
FORMATS = {
    "bag2": lambda folder, sent: write_folder(folder / "run", sent, "sqlite3"),
    "bag2 of mcap": lambda folder, sent: write_folder(folder / "run", sent, "mcap", "storage"),
    "mcap": lambda folder, sent: write_mcap(folder / "run.mcap", sent, "zstd"),
    "bag": lambda folder, sent: write_ros1(folder / "run.bag", sent),
}
FRAMES = [("map", "base"), ("camera", "odom"), ("base", "camera")]


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A home for evo's settings."""
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="module")
def evo(home):
    """A function: imports a module of evo, whose settings are in that home."""
    pytest.importorskip("rclpy")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "home", classmethod(lambda _: home))
        pytest.importorskip("evo.tools.settings")
    return pytest.importorskip


@pytest.fixture
def recording(request, tmp_path):
    """A recording in one of FORMATS: the way of a robot at 100 Hz for 2 s."""
    return FORMATS[request.param](tmp_path, drive(200, begin_ns=BEGIN, step_ns=S // 100))


in_every_format = pytest.mark.parametrize("recording", FORMATS, indirect=True)


def reader_of(path):
    from rosbags import rosbag1, rosbag2

    return rosbag1.Reader(path) if path.suffix == ".bag" else rosbag2.Reader(path)


def quaternions(trajectory):
    """x y z w."""
    return np.roll(trajectory.orientations_quat_wxyz, -1, axis=1)


@in_every_format
@pytest.mark.parametrize(("target", "source"), FRAMES)
def test_evos_cache_finds_the_transforms_that_we_find(evo, recording, target, source):
    tf_cache = evo("evo.tools.tf_cache")
    cache = tf_cache.TfCache()
    assert type(cache.buffer) is tf2_py.BufferCore
    with reader_of(recording) as reader:
        found = cache.get_trajectory(reader, f"/tf:{target}.{source}")
    buffer = tf2_ros_tools.bag.load(recording)
    moves = (target, source) != ("base", "camera")
    # evo asks at this rate from the first transform on; what is static once, at time 0.
    times = BEGIN + np.arange(0, 2 * S - S // 100, S // LOOKUPS_HZ) if moves else [0]
    translations, rotations = buffer.lookup_transforms(target, source, times)
    assert_allclose(found.timestamps, np.array(times) / 1e9, rtol=0, atol=1e-6)
    assert_allclose(found.positions_xyz, translations, rtol=0, atol=1e-15)
    assert_allclose(quaternions(found), rotations, rtol=0, atol=1e-15)


@in_every_format
def test_evo_takes_its_own_times_and_leaves_out_those_without_an_answer(evo, recording):
    tf_cache = evo("evo.tools.tf_cache")
    seconds = [BEGIN // S + 0.5, BEGIN // S - 1.0, BEGIN // S + 1.25, BEGIN // S + 9.0]

    # One that can be sorted: its own TfDuration cannot.
    class Time(tf_cache.TfDuration):
        def __lt__(self, other):
            return self.nanoseconds < other.nanoseconds

    with reader_of(recording) as reader:
        found = tf_cache.TfCache().get_trajectory(
            reader, "/tf:map.camera", [Time.from_sec(s) for s in seconds]
        )
    translations, rotations = tf2_ros_tools.bag.load(recording).lookup_transforms(
        "map", "camera", [BEGIN + S // 2, BEGIN + S * 5 // 4]
    )
    assert_allclose(found.timestamps, [seconds[0], seconds[2]], rtol=0, atol=1e-6)
    assert_allclose(found.positions_xyz, translations, rtol=0, atol=1e-6)
    assert_allclose(quaternions(found), rotations, rtol=0, atol=1e-6)


def test_frames_without_connection_are_evos_error(evo, tmp_path):
    tf_cache = evo("evo.tools.tf_cache")
    path = write_mcap(tmp_path / "run.mcap", drive(5))
    with reader_of(path) as reader, pytest.raises(tf_cache.TfCacheException, match="Could not load.*nowhere"):
        tf_cache.TfCache().get_trajectory(reader, "/tf:map.nowhere")


@pytest.fixture
def evo_traj(home, tmp_path):
    """A function: runs evo_traj; what it wrote, an array of stamps in s, x y z, qx qy qz qw."""
    pytest.importorskip("rclpy")
    pytest.importorskip("evo")
    program = shutil.which("evo_traj", path=os.path.dirname(sys.executable))
    out = tmp_path / "evo"
    out.mkdir()

    def run(*arguments):
        ended = subprocess.run(
            [program, *arguments, "--save_as_tum"],
            cwd=out,
            env={**os.environ, "HOME": str(home), "MPLBACKEND": "Agg"},
            text=True,
            capture_output=True,
            timeout=3 * DEADLINE_S,
        )
        assert ended.returncode == 0, ended.stdout + ended.stderr
        [written] = out.rglob("*.tum")
        return np.loadtxt(written)

    return run


@pytest.fixture
def our_tum(tmp_path):
    """A function: the path of what tf2_bag makes of a recording, at evo's rate."""

    def look_up(recording, target, source):
        path = str(tmp_path / "ours.tum")
        options = ["--rate", str(LOOKUPS_HZ), "-o", path]
        status, _, err = ended("tf2_bag", "lookup", str(recording), target, source, *options)
        assert status == 0, err
        return path

    return look_up


@pytest.mark.parametrize(
    ("command", "recording"), [(name.split()[0], name) for name in FORMATS], indirect=["recording"]
)
def test_evo_traj_writes_the_poses_that_tf2_bag_writes(command, recording, evo_traj, our_tum):
    theirs = evo_traj(command, str(recording), "/tf:map.camera")
    ours = np.loadtxt(our_tum(recording, "map", "camera"))
    assert len(ours) == 20
    assert_allclose(theirs[:, 0], ours[:, 0], rtol=0, atol=1e-6)  # evo's seconds are doubles
    assert_allclose(theirs[:, 1:], ours[:, 1:], rtol=0, atol=1e-12)


@pytest.mark.parametrize("recording", ["mcap"], indirect=True)
def test_evo_traj_reads_what_tf2_bag_writes(recording, evo_traj, our_tum):
    path = our_tum(recording, "map", "camera")
    read = evo_traj("tum", path)
    assert_allclose(read, np.loadtxt(path), rtol=0, atol=1e-6)
