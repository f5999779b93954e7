# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An rclpy that nobody knows yet: everything works, if need be through executors; texts give its version."""

import pytest
from paths import PROGRAMS
from processes import output_of

from tf2_ros_cython import _ros_in_use

TOPICS = "without an executor: /tf, /tf_static"
NOTHING = "without an executor: nothing"
THE_REST = ["filter", "on_change", "future", "await", "server and client", "threads of listeners"]


@pytest.mark.parametrize(
    ("missing", "received"),
    [
        ([], TOPICS),
        (["attributes"], TOPICS),
        (["functions"], NOTHING),
        (["functions", "attributes"], NOTHING),
    ],
)
def test_what_it_lacks_is_done_without(missing, received):
    assert output_of(PROGRAMS / "uses_unknown_rclpy.py", *missing).splitlines() == [received, *THE_REST]


def test_a_release_is_known_by_its_name_or_by_its_version():
    assert _ros_in_use.describe("10.0.10") == "Lyrical (rclpy 10.0.10)"
    assert _ros_in_use.describe("99.0.1") == "of rclpy 99.0.1"
