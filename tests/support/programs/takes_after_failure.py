# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receives three messages that wait at once, of which the middleware fails to hand over the first one."""

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time
from waiting import until

from tf2_ros import Buffer, TransformBroadcaster, TransformListener

FRAMES = ("first", "second", "third")

rclpy.init()
node, buffer = rclpy.create_node("hearing"), Buffer()
broadcaster = TransformBroadcaster(rclpy.create_node("sending"))
with TransformListener(buffer, node) as listener:
    inbox = listener._tf2_state.receiver.inbox
    inbox.fill(None)  # so that all of them wait
    until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)
    for frame in FRAMES:
        message = TransformStamped(child_frame_id=frame)
        message.header.frame_id = "base"
        broadcaster.sendTransform(message)
    assert broadcaster.pub_tf.wait_for_all_acked()
    inbox.fill(buffer)
    until(lambda: buffer.can_transform("base", FRAMES[-1], Time()))
    print("received:", *(frame for frame in FRAMES if buffer.can_transform("base", frame, Time())))
rclpy.shutdown()
