# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Broadcasts a robot with faults, for the picture on the page about debugging.

Besides map, odom, base_link and camera, at 50 Hz, there is a frame for each fault, which its name says.
"""

import signal
from collections.abc import Iterator

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.signals import SignalHandlerOptions

from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

PERIOD_S = 0.02
STOPPED_AFTER = 50  # periods
GAP = 50  # periods
SLOW = 10  # periods between two transforms
AHEAD, NOT_AHEAD = Duration(seconds=5), Duration()


class Robot:
    """The nodes of the robot and of an intruder."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("robot", namespace="/fleet")
        intruder = rclpy.create_node("intruder")
        self.moving, self.fixed = TransformBroadcaster(self.node), StaticTransformBroadcaster(self.node)
        self.of_intruder = TransformBroadcaster(intruder)
        self.fixed.sendTransform(
            [self.transform("base_link", "camera"), self.transform("odom", "static_and_dynamic")]
        )

    def transform(self, parent: str, child: str, ahead: Duration = NOT_AHEAD) -> TransformStamped:
        """The transform of a frame now."""
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        message.header.stamp = (self.node.get_clock().now() + ahead).to_msg()
        message.transform.rotation.w = 0.0 if child == "broken" else 1.0
        return message

    def frames(self, period: int) -> Iterator[TransformStamped]:
        """What is sent in a period."""
        yield self.transform("map", "odom")
        yield self.transform("odom", "base_link")
        yield self.transform("odom" if period % 2 else "map", "two_parents")
        for child in ("two_publishers", "static_and_dynamic", "broken"):
            yield self.transform("odom", child)
        yield self.transform("odom", "ahead", AHEAD)
        for parent, child in (("loop_b", "loop_a"), ("loop_a", "loop_b"), ("sea", "island")):
            yield self.transform(parent, child)
        if period < STOPPED_AFTER:
            yield self.transform("odom", "stopped")
        if period // GAP % 2 == 0:
            yield self.transform("odom", "with_gaps")
        if period % SLOW == 0:
            yield self.transform("odom", "slow")

    def run(self) -> None:
        """Send, from when a listener exists, until SIGTERM."""
        period = 0
        while not signal.sigtimedwait({signal.SIGTERM}, PERIOD_S):
            if period or self.moving.pub_tf.get_subscription_count():
                self.moving.sendTransform([*self.frames(period)])
                self.of_intruder.sendTransform(self.transform("odom", "two_publishers"))
                period += 1


if __name__ == "__main__":
    # Blocked, it waits for the next period: a handler could interrupt the middleware.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    Robot().run()
    rclpy.shutdown()
