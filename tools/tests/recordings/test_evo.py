"""evo, which looks up the transforms of recordings with this `tf2_py`, and reads what tf2_bag writes."""

import os
import subprocess
import sys

import numpy as np
import pytest
from making_bags import S, drive, write_mcap
from numpy.testing import assert_allclose
from starting_programs import ended
from waiting import DEADLINE_S

pytestmark = [
    pytest.mark.ours,
    pytest.mark.long("needs evo"),
    pytest.mark.skipif(sys.version_info < (3, 11), reason="evo needs Python 3.11"),
]

BEGIN = 1_700_000_000 * S
LOOKUPS_HZ = 10  # evo's setting tf_cache_lookup_frequency


def test_evo_traj_reads_what_tf2_bag_writes_and_writes_the_same(tmp_path):
    pytest.importorskip("evo")
    path, ours = tmp_path / "run.mcap", tmp_path / "ours.tum"
    write_mcap(path, drive(200, begin_ns=BEGIN, step_ns=S // 100))
    options = ("--rate", str(LOOKUPS_HZ), "-o", str(ours))
    status, _, err = ended("tf2_bag", "lookup", str(path), "map", "camera", *options)
    assert status == 0, err
    for arguments in (("mcap", str(path), "/tf:map.camera"), ("tum", str(ours))):
        out = tmp_path / arguments[0]
        out.mkdir()
        done = subprocess.run(
            [os.path.join(os.path.dirname(sys.executable), "evo_traj"), *arguments, "--save_as_tum"],
            cwd=out,
            env={**os.environ, "HOME": str(tmp_path), "MPLBACKEND": "Agg"},
            text=True,
            capture_output=True,
            timeout=3 * DEADLINE_S,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        [written] = out.rglob("*.tum")
        # evo's seconds are doubles.
        assert_allclose(_same_signs(np.loadtxt(written)), _same_signs(np.loadtxt(ours)), rtol=0, atol=1e-6)


def _same_signs(rows):
    # tf2_bag continues the sign of quaternions from row to row; evo, as tf2 does, gives each row's own.
    rows[rows[:, -1] < 0, -4:] *= -1
    return rows
