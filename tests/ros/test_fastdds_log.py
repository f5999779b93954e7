# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What Fast DDS logs is in no output that a test compares."""

import os
import sys

import pytest
from fastdds_log import LOG
from paths import SUPPORT
from processes import run
from rclpy.utilities import get_rmw_implementation_identifier

pytestmark = [
    pytest.mark.ours,
    pytest.mark.skipif(
        get_rmw_implementation_identifier() != "rmw_fastrtps_cpp", reason="its log is that of Fast DDS"
    ),
]

PROGRAM = "import rclpy; rclpy.init(); rclpy.create_node('logging'); print('done')"


@pytest.mark.parametrize("profiles", ["fastdds.xml", "fastdds_log.xml"])
def test_a_program_prints_only_what_it_writes_itself(profiles):
    wrong = f"no.server.{os.path.splitext(profiles)[0]}"
    chosen = {name: str(SUPPORT / profiles) for name in os.environ if name.endswith("_PROFILES_FILE")}
    done = run(sys.executable, "-c", PROGRAM, env={**os.environ, **chosen, "ROS_DISCOVERY_SERVER": wrong})
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")
    assert wrong in LOG.read_text()
