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
from tf2_ros_tools import bag

pytestmark = [
    pytest.mark.ours,
    pytest.mark.long("needs evo"),
    pytest.mark.skipif(sys.version_info < (3, 11), reason="evo needs Python 3.11"),
]

BEGIN = 1_700_000_000 * S
LOOKUPS_HZ = 10  # evo's setting tf_cache_lookup_frequency
FORMATS = {
    "folder": lambda folder, sent: write_folder(folder / "run", sent, "sqlite3"),
    "mcap": lambda folder, sent: write_mcap(folder / "run.mcap", sent, "zstd"),
    "bag": lambda folder, sent: write_ros1(folder / "run.bag", sent),
}


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A home for evo's settings."""
    pytest.importorskip("rclpy")
    return tmp_path_factory.mktemp("home")


def recording(form, folder):
    """The way of a robot at 100 Hz for 2 s."""
    return FORMATS[form](folder, drive(200, begin_ns=BEGIN, step_ns=S // 100))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("target", "source"), [("map", "base"), ("camera", "odom"), ("base", "camera")])
def test_evos_cache_finds_the_transforms_that_we_find(home, monkeypatch, form, target, source, tmp_path):
    from rosbags import rosbag1, rosbag2

    monkeypatch.setattr(Path, "home", classmethod(lambda _: home))
    cache = pytest.importorskip("evo.tools.tf_cache").TfCache()
    assert type(cache.buffer) is tf2_py.BufferCore
    path = recording(form, tmp_path)
    with (rosbag1 if form == "bag" else rosbag2).Reader(path) as reader:
        found = cache.get_trajectory(reader, f"/tf:{target}.{source}")
    moves = (target, source) != ("base", "camera")
    # evo asks at this rate from the first transform on; what is static once, at time 0.
    times = BEGIN + np.arange(0, 2 * S - S // 100, S // LOOKUPS_HZ) if moves else [0]
    translations, rotations = bag.load(path).lookup_transforms(target, source, times)
    assert_allclose(found.timestamps, np.array(times) / 1e9, rtol=0, atol=1e-6)
    assert_allclose(found.positions_xyz, translations, rtol=0, atol=1e-15)
    assert_allclose(np.roll(found.orientations_quat_wxyz, -1, axis=1), rotations, rtol=0, atol=1e-15)


def test_evo_traj_reads_what_tf2_bag_writes_and_writes_the_same(home, tmp_path):
    pytest.importorskip("evo")
    program = shutil.which("evo_traj", path=os.path.dirname(sys.executable))
    path, ours = recording("mcap", tmp_path), tmp_path / "ours.tum"
    options = ("--rate", str(LOOKUPS_HZ), "-o", str(ours))
    status, _, err = ended("tf2_bag", "lookup", str(path), "map", "camera", *options)
    assert status == 0, err
    for arguments in (("mcap", str(path), "/tf:map.camera"), ("tum", str(ours))):
        out = tmp_path / arguments[0]
        out.mkdir()
        done = subprocess.run(
            [program, *arguments, "--save_as_tum"],
            cwd=out,
            env={**os.environ, "HOME": str(home), "MPLBACKEND": "Agg"},
            text=True,
            capture_output=True,
            timeout=3 * DEADLINE_S,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        [written] = out.rglob("*.tum")
        # evo's seconds are doubles.
        assert_allclose(np.loadtxt(written), np.loadtxt(ours), rtol=0, atol=1e-6)
