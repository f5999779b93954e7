"""No executor of one's own: the program calls spin_once in its loops, with and without a timeout."""

import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile

import tf2_ros
from tf2_msgs.msg import TFMessage


def check(deadline):
    if time.monotonic() > deadline:
        raise TimeoutError("nothing arrived")


def wheel(sec, angle):
    t = TransformStamped()
    t.header.frame_id = "axle"
    t.header.stamp.sec = sec
    t.child_frame_id = "wheel"
    t.transform.translation.y = angle
    t.transform.rotation.w = 1.0
    return t


rclpy.init()
node = rclpy.create_node("looping")
tf_buffer = tf2_ros.Buffer()
tf_listener = tf2_ros.TransformListener(tf_buffer, node)
publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
deadline = time.monotonic() + 60.0

while publisher.get_subscription_count() < 1:
    check(deadline)
    rclpy.spin_once(node, timeout_sec=0.05)
print("connected")

# With a timeout: until it is there.
publisher.publish(TFMessage(transforms=[wheel(1, 0.5)]))
while not tf_buffer.can_transform("axle", "wheel", rclpy.time.Time()):
    check(deadline)
    rclpy.spin_once(node, timeout_sec=0.1)
print("first:", tf_buffer.lookup_transform("axle", "wheel", rclpy.time.Time()).transform.translation.y)

# Without a timeout: until the last of several messages is there.
for sec in range(2, 8):
    publisher.publish(TFMessage(transforms=[wheel(sec, sec / 4)]))
while tf_buffer.get_latest_common_time("axle", "wheel").nanoseconds < 7 * 10**9:
    check(deadline)
    rclpy.spin_once(node)
newest = tf_buffer.get_latest_common_time("axle", "wheel")
print("newest:", newest.nanoseconds // 10**9, "s")
for ns in (2_000_000_000, 4_500_000_000, 6_800_000_000):
    found = tf_buffer.lookup_transform("axle", "wheel", rclpy.time.Time(nanoseconds=ns))
    print(f"{ns / 1e9} s: {found.transform.translation.y:.3f}")

# Nothing left: this one ends by its timeout, and one of zero at once.
rclpy.spin_once(node, timeout_sec=0.2)
rclpy.spin_once(node, timeout_sec=0)
print("still newest:", tf_buffer.get_latest_common_time("axle", "wheel").nanoseconds // 10**9, "s")

# A reply to every message, one spin for both.
for sec in range(10, 13):
    publisher.publish(TFMessage(transforms=[wheel(sec, -1.0), wheel(sec + 10, -2.0)]))
    while not tf_buffer.can_transform("axle", "wheel", rclpy.time.Time(seconds=sec + 10)):
        check(deadline)
        rclpy.spin_once(node)
    both = [tf_buffer.lookup_transform("axle", "wheel", rclpy.time.Time(seconds=s)) for s in (sec, sec + 10)]
    print(sec, [one.transform.translation.y for one in both])

node.destroy_node()
rclpy.shutdown()
