"""Call tf2_ros by the names that ROS 2 gives it: a sourced ROS 2's, or this project's."""

import itertools
import os
import threading
import time
import xml.etree.ElementTree

import rclpy
import serving
from builtin_interfaces.msg import Time as TimeMessage
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time
from serving import Tf2, serve, time_paced

from tf2_ros import Buffer, TransformListener

S = 1_000_000_000
DISCOVERY_S = 60
HISTORY_S = 0.8  # to look up in


def fill(message, child, parent, stamp_ns, pose):
    return serving.fill_transform(message, child, parent, stamp_of(stamp_ns), pose)


def stamp_of(ns):
    return TimeMessage(sec=ns // S, nanosec=ns % S)


class Ros2(Tf2):
    message = TransformStamped
    stamp_of = staticmethod(stamp_of)

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

    def buffer_of(self, cache_ns):
        return Buffer(Duration(nanoseconds=cache_ns))

    def time_of(self, ns):
        return Time(nanoseconds=ns)

    def listen(self, buffer, **options):
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
            self.order_stop_listening()
            self.node.destroy_node()
            rclpy.shutdown()

    def order_online(self, pairs, age_s, batch, pause_s, seconds):
        """Time lookups, `age_s` ago, in batches with pauses between them, while transforms arrive."""
        round_and_round = itertools.cycle(pairs)
        times = []
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            time.sleep(pause_s)
            past = self.time_of(time.time_ns() - int(age_s * S))
            calls = [(*pair, past) for pair in itertools.islice(round_and_round, batch)]
            times += time_paced(self.buffer.lookup_transform, calls)
        return {"ns": times}


if __name__ == "__main__":
    ros2 = Ros2()
    serve(ros2, ros2.end)
