# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What receives transforms needs no executor."""

from waiting import until

S = 10**9


def test_a_bare_core_is_filled_as_well(tf2_ros, tf2_py, node, peer):
    core = tf2_py.BufferCore()
    with tf2_ros.TransformListener(core, node) as listener:
        assert listener.receives
        peer().send(("map", "robot", 1 * S, 1))
        until(lambda: core._frameExists("robot"))
