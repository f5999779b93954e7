# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Broadcasts the transforms of a robot at 50 Hz, once there is a subscriber: map, odom, base_link, camera.

Prints a line when it begins to wait for subscribers.
"""

import signal

import rclpy
from rclpy.signals import SignalHandlerOptions
from times_and_transforms import transform

from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

PERIOD_S = 0.02


def main():
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("robot", namespace="/fleet")
    broadcaster, static = TransformBroadcaster(node), StaticTransformBroadcaster(node)

    def made(parent, child):
        return transform(parent, child, ns=node.get_clock().now().nanoseconds)

    static.sendTransform(made("base_link", "camera"))
    print("ready", flush=True)
    is_heard = False
    while not signal.sigtimedwait({signal.SIGTERM}, PERIOD_S):
        is_heard = is_heard or broadcaster.pub_tf.get_subscription_count() > 0
        if is_heard:
            broadcaster.sendTransform([made("map", "odom"), made("odom", "base_link")])
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    # Blocked, it waits for the next period: a handler could interrupt the middleware.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    main()
