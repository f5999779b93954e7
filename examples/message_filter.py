"""A lidar whose transforms arrive late: a message filter passes each scan once its transform is available.

Ends by itself. The exit status is 0 only if every scan passed, in order.
"""

import threading

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time
from sensor_msgs.msg import LaserScan

from tf2_ros import Buffer, MessageFilter, TransformBroadcaster, TransformListener

SCANS = 20
PERIOD_S = 0.05
DELAY = 4  # of the transforms, in periods
LIMIT_S = 15.0


def main():
    rclpy.init()
    node = rclpy.create_node("mapping")
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node)
    passed, done = [], threading.Event()

    def on_scan(scan):
        stamp = Time.from_msg(scan.header.stamp)
        found = buffer.lookup_transform("map", scan.header.frame_id, stamp)
        passed.append(stamp.nanoseconds)
        x = found.transform.translation.x
        print(f"scan of {stamp.nanoseconds / 1e9:.2f} s: the lidar was at x = {x:.2f} m")
        if len(passed) == SCANS:
            done.set()

    def on_failure(scan, reason):
        print(f"a scan was dropped: {reason.value}")

    topic = (LaserScan, "scan", 10)
    scans = MessageFilter(topic, buffer, "map", 50, node=node, buffer_timeout=Duration(seconds=2))
    scans.registerCallback(on_scan)
    scans.registerFailureCallback(on_failure)

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    publish(node, done)
    complete = done.wait(LIMIT_S)
    scans.close()
    listener.unregister()
    executor.create_task(executor.shutdown)
    spinning.join()
    print(scans.statistics())
    rclpy.shutdown()
    return 0 if complete and passed == sorted(passed) else 1


def publish(node, done):
    """Send scans, and each scan's transform DELAY periods later."""
    scans = node.create_publisher(LaserScan, "scan", 10)
    broadcaster = TransformBroadcaster(node)
    ticks = threading.Event()
    while not (scans.get_subscription_count() and broadcaster.pub_tf.get_subscription_count()):
        ticks.wait(0.01)
    for tick in range(SCANS + DELAY):
        if tick < SCANS:
            scan = LaserScan()
            scan.header.frame_id = "lidar"
            scan.header.stamp = stamp(tick)
            scans.publish(scan)
        if tick >= DELAY:
            transform = TransformStamped()
            transform.header.frame_id, transform.child_frame_id = "map", "lidar"
            transform.header.stamp = stamp(tick - DELAY)
            transform.transform.translation.x = 0.1 * (tick - DELAY)
            broadcaster.sendTransform(transform)
        done.wait(PERIOD_S)


def stamp(tick):
    """The time of a tick; the first one is at 1 s."""
    return Time(nanoseconds=round((1 + tick * PERIOD_S) * 1e9)).to_msg()


if __name__ == "__main__":
    raise SystemExit(main())
