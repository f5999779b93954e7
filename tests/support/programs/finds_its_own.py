"""
Looks up each transform at once that it has published itself; prints how many of so many it missed.

With the middleware's own settings, which deliver within a process before the publisher returns.
"""

import sys
import threading

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformListener

count = int(sys.argv[1])
rclpy.init()
node = rclpy.create_node("finding")
buffer = Buffer()
listener = TransformListener(buffer, node)
publisher = node.create_publisher(TFMessage, "/tf", 100)
while not publisher.get_subscription_count():
    threading.Event().wait(0.005)
transform = TransformStamped(child_frame_id="robot")
transform.header.frame_id, transform.transform.rotation.w = "map", 1.0
missed = 0
for number in range(1, count + 1):
    transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(number * 1_000_000, 10**9)
    publisher.publish(TFMessage(transforms=[transform]))
    missed += not buffer.can_transform("map", "robot", Time(nanoseconds=number * 1_000_000))
print(f"{missed} of {count} missed", flush=True)
rclpy.shutdown()
