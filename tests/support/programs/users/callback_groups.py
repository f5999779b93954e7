"""A MultiThreadedExecutor: one timer publishes, others block in lookups, in callback groups of their own."""

import threading
from typing import ClassVar

import rclpy
import rclpy.executors
from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from tf2_ros import Buffer, TransformBroadcaster, TransformException, TransformListener


class Odometry(Node):
    """50 Hz, one metre a second; stamps count ticks."""

    def __init__(self):
        super().__init__("odometry")
        self.broadcaster = TransformBroadcaster(self, qos=50)
        self.ticks = 0
        self.create_timer(0.02, self.tick)

    def tick(self):
        if self.broadcaster.pub_tf.get_subscription_count() == 0:
            return
        self.ticks += 1
        t = TransformStamped()
        t.header.frame_id, t.child_frame_id = "odom", "base_footprint"
        t.header.stamp = Time(nanoseconds=self.ticks * 20_000_000).to_msg()
        t.transform.translation.x = 0.02 * self.ticks
        t.transform.rotation.w = 1.0
        self.broadcaster.sendTransform(t)


class Consumers(Node):
    WANTED: ClassVar = {"early": 0.1, "middle": 0.37, "late": 0.755}  # seconds

    def __init__(self):
        super().__init__("consumers")
        self.buffer = Buffer(cache_time=Duration(seconds=100))
        self.listener = TransformListener(self.buffer, self)
        self.results = {}
        self.lock = threading.Lock()
        self.all_done = threading.Event()
        self.once = {}
        shared = ReentrantCallbackGroup()
        for name in self.WANTED:
            group = shared if name != "late" else MutuallyExclusiveCallbackGroup()
            self.once[name] = self.create_timer(0.01, lambda n=name: self.ask(n), callback_group=group)
        self.hopeless = self.create_timer(
            0.01, self.ask_in_vain, callback_group=MutuallyExclusiveCallbackGroup()
        )

    def ask(self, name):
        with self.lock:
            if self.once[name].is_canceled():
                return
            self.once[name].cancel()
        when = Time(nanoseconds=round(self.WANTED[name] * 1e9))
        found = self.buffer.lookup_transform("odom", "base_footprint", when, Duration(seconds=60))
        self.keep(name, f"x = {found.transform.translation.x:.3f}")

    def ask_in_vain(self):
        self.hopeless.cancel()
        try:
            self.buffer.lookup_transform("odom", "cloud_nine", Time(), timeout=Duration(seconds=0.3))
        except TransformException as error:
            self.keep("hopeless", type(error).__name__)

    def keep(self, name, result):
        with self.lock:
            self.results[name] = result
            if len(self.results) == 4:
                self.all_done.set()


def main(args=None):
    rclpy.init(args=args)
    executor = rclpy.executors.MultiThreadedExecutor(num_threads=6)
    nodes = [Odometry(), Consumers()]
    for node in nodes:
        executor.add_node(node)
    ending = threading.Event()

    def spin():
        while not ending.is_set():
            executor.spin_once(timeout_sec=0.1)

    spinner = threading.Thread(target=spin)
    spinner.start()
    in_time = nodes[1].all_done.wait(65)
    ending.set()
    spinner.join()
    executor.shutdown()
    print("in time:", in_time)
    for name, result in sorted(nodes[1].results.items()):
        print(f"{name}: {result}")
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
