# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How old the data of the frames between two frames is, on the clock of the buffer."""

import copy
import math
import time

import pytest
from rclpy.parameter import Parameter
from simulated_clock import simulate
from times_and_transforms import S, insert, transform

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_ros, node):
    """map > odom > base > arm and lidar; the clock is at 100 s."""
    simulate(node, seconds=100)
    buffer = tf2_ros.Buffer(node=node)
    insert(buffer, "map", "odom", 98, 98.5)
    insert(buffer, "odom", "base", 99.875, 99.75)
    insert(buffer, "base", "arm", 97)
    buffer.set_transform_static(transform("base", "lidar", 50), "x")
    return buffer


def test_ages_follow_the_clock(buffer, node):
    simulate(node, seconds=103)
    assert buffer.ages("odom", "base") == {"base": 3.125}
    simulate(node, seconds=102.5)  # less than what clears the buffer
    assert buffer.ages("odom", "base") == {"base": 2.625}


def test_all_is_infinitely_old_until_simulated_time_begins(tf2_ros, node):
    node.set_parameters([Parameter("use_sim_time", value=True)])
    buffer = tf2_ros.Buffer(node=node)
    insert(buffer, "map", "base", 1)
    assert buffer.ages("map", "base") == {"base": math.inf}


def test_a_buffer_without_a_node_counts_system_time(tf2_ros):
    buffer = tf2_ros.Buffer()
    before_ns = time.time_ns()
    buffer.set_transform(transform("map", "base", ns=before_ns - 5 * S), "x")
    age = buffer.ages("map", "base")["base"]
    assert 5 <= age <= 5 + (time.time_ns() - before_ns) / S


def test_a_copy_counts_system_time(buffer):
    assert copy.deepcopy(buffer).ages("odom", "base")["base"] > 10**9


@pytest.mark.parametrize("hops", [1, 999])
def test_long_paths_have_the_ages_of_all_their_frames(buffer, hops):
    buffer.set_transforms([transform(f"f{i}", f"f{i + 1}", ns=95 * S + i) for i in range(hops)], "x")
    ages = buffer.ages("f0", f"f{hops}")
    assert list(ages) == [f"f{i}" for i in range(hops, 0, -1)]
    assert ages["f1"] == 5.0
