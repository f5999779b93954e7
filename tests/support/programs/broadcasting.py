"""
Broadcasts the transforms of a robot at 50 Hz, once there is a subscriber: map, odom, base_link, camera.

With the argument `faults` also one frame for each fault, which it names: two_parents, two_publishers, ahead,
stopped, with_gaps, slow (5 Hz), loop_a and loop_b, island (in a tree of its own), static_and_dynamic,
broken (whose rotation has no length).
"""

import signal
import sys

import rclpy
from making import transform
from rclpy.duration import Duration
from rclpy.signals import SignalHandlerOptions

from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

PERIOD_S = 0.02
STOPPED_AFTER = 50  # periods
GAP = 50
SLOW = 10
AHEAD, NOT_AHEAD = Duration(seconds=5), Duration()


def main(faults):
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("robot", namespace="/fleet")
    other = rclpy.create_node("intruder")
    broadcaster, static = TransformBroadcaster(node), StaticTransformBroadcaster(node)
    second = TransformBroadcaster(other) if faults else None

    def made(parent, child, ahead=NOT_AHEAD):
        return transform(parent, child, ns=(node.get_clock().now() + ahead).nanoseconds)

    def faulty(period):
        yield made("odom" if period % 2 else "map", "two_parents")
        yield made("odom", "two_publishers")
        yield made("odom", "ahead", AHEAD)
        yield made("loop_b", "loop_a")
        yield made("loop_a", "loop_b")
        yield made("sea", "island")
        yield made("odom", "static_and_dynamic")
        broken = made("odom", "broken")
        broken.transform.rotation.w = 0.0
        yield broken
        if period < STOPPED_AFTER:
            yield made("odom", "stopped")
        if period // GAP % 2 == 0:
            yield made("odom", "with_gaps")
        if period % SLOW == 0:
            yield made("odom", "slow")

    static.sendTransform([made("base_link", "camera")])
    if faults:
        static.sendTransform([made("odom", "static_and_dynamic")])
    period = 0
    while not signal.sigtimedwait({signal.SIGTERM}, PERIOD_S):
        if period == 0 and broadcaster.pub_tf.get_subscription_count() == 0:
            continue
        transforms = [made("map", "odom"), made("odom", "base_link")]
        if faults:
            transforms += faulty(period)
            second.sendTransform([made("odom", "two_publishers")])
        broadcaster.sendTransform(transforms)
        period += 1
    node.destroy_node()
    other.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    # Blocked, it waits for the next period: a handler could interrupt the middleware.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    main(sys.argv[1:] == ["faults"])
