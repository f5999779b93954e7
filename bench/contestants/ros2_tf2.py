"""Owns the calls of tf2_ros by the names that ROS 2 gives them: a sourced ROS 2's, or this project's."""

import os
import threading
import time
import xml.etree.ElementTree

from builtin_interfaces.msg import Time as TimeMessage
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time
from serving import Contestant, serve, time_calls

from tf2_ros import Buffer

AUTHORITY = "bench"
S = 1_000_000_000
DISCOVERY_S = 20
HISTORY_S = 0.8  # to look up in


def fill(message, child, parent, stamp_ns, pose):
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp = TimeMessage(sec=stamp_ns // S, nanosec=stamp_ns % S)
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w = pose
    return message


class Ros2(Contestant):
    def __init__(self):
        super().__init__()
        self.buffer = None
        self.node = self.listener = None

    def about(self):
        for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":"):
            manifest = os.path.join(prefix, "share", "tf2_ros_py", "package.xml")
            if os.path.exists(manifest):
                version = xml.etree.ElementTree.parse(manifest).findtext("version")
                return {"version": version, "returns": "geometry_msgs/TransformStamped"}
        return {"version": "unknown", "returns": "geometry_msgs/TransformStamped"}

    def load(self, tree):
        self.buffer = Buffer(Duration(nanoseconds=tree.cache_ns))
        message = TransformStamped()
        for child, parent, static, stamp_ns, pose in tree.records():
            fill(message, child, parent, stamp_ns, pose)
            if static:
                self.buffer.set_transform_static(message, AUTHORITY)
            else:
                self.buffer.set_transform(message, AUTHORITY)

    def calls(self, way, queries):
        function = {"buffer": self.buffer.lookup_transform, "core": self.buffer.lookup_transform_core}[way]
        return function, [(target, source, Time(nanoseconds=ns)) for target, source, ns in queries]

    def numbers(self, answer):
        t, q = answer.transform.translation, answer.transform.rotation
        return t.x, t.y, t.z, q.x, q.y, q.z, q.w

    def inserts(self, way, transforms):
        messages = [fill(TransformStamped(), *transform) for transform in transforms]
        return self.buffer.set_transform, [(message, AUTHORITY) for message in messages], 1

    def listen(self, buffer, **options):
        import rclpy

        from tf2_ros import TransformListener

        if self.node is None:
            rclpy.init()
            self.node = rclpy.create_node("bench_listener")
        self.listener = TransformListener(buffer, self.node, **options)

    def order_listen(self, cache_s, frame_count):
        """Fill a new buffer from /tf and /tf_static, until the publishing process has sent all frames."""
        self.buffer = Buffer(Duration(seconds=cache_s))
        self.listen(self.buffer, spin_thread=True)
        deadline = time.monotonic() + DISCOVERY_S
        while len(self.buffer._getFrameStrings()) < frame_count:
            if time.monotonic() > deadline:
                return {"error": f"only {len(self.buffer._getFrameStrings())} frames arrived"}
            threading.Event().wait(0.05)
        threading.Event().wait(HISTORY_S)
        return {}

    def order_stop_listening(self):
        if self.listener is not None:
            self.listener.unregister()
            self.listener = None
        return {}

    def end(self):
        """Leave the network: otherwise the publisher waits until this process counts as lost."""
        if self.node is not None:
            import rclpy

            self.order_stop_listening()
            self.node.destroy_node()
            rclpy.shutdown()

    def order_online(self, way, pairs, age_s, count, budget_s):
        """Time lookups while transforms arrive; `age_s` ago, or 0 for the latest."""
        age_ns = int(age_s * S)
        time_ns = time.time_ns() - age_ns if age_ns else 0
        function, calls = self.calls(way, [(target, source, time_ns) for target, source in pairs])
        times, failed, empty = time_calls(function, calls, count, budget_s)
        return {"ns": times, "failed": failed, "empty_ns": empty}


if __name__ == "__main__":
    ros2 = Ros2()
    serve(ros2, ros2.end)
