# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program tf2_buffer_server, as a process of its own."""

import pytest
from rclpy.duration import Duration
from starting_programs import running
from times_and_transforms import S, at, translation
from waiting import DEADLINE_S

LONG = Duration(seconds=DEADLINE_S)


def test_a_buffer_server_answers_from_what_it_receives_and_keeps(peer, tf2_ros, tf2_py, node):
    client = tf2_ros.BufferClient(node, "tf2_buffer_server")
    with running("tf2_buffer_server", "--ros-args", "-p", "buffer_size:=5.0"):
        talker = peer()
        talker.send(("map", "robot", S, 1.0))
        assert translation(client.lookup_transform("map", "robot", at(1), LONG)) == (1.0, 0.0, 0.0)
        with pytest.raises(tf2_py.LookupException, match="does not exist"):
            client.lookup_transform("map", "nobody", at(1))
        talker.send(("map", "robot", 100 * S, 2.0), ("map", "robot", 101 * S, 2.0))
        client.lookup_transform("map", "robot", at(101), LONG)
        with pytest.raises(tf2_py.ExtrapolationException):
            client.lookup_transform("map", "robot", at(1))
    client.destroy()
