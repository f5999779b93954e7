# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Callbacks that are coroutines: a service and a timer await transforms in one single-threaded executor."""

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from std_srvs.srv import Trigger

import tf2_ros


class Locator(Node):
    def __init__(self):
        super().__init__("locator")
        self.buffer = tf2_ros.Buffer(node=self)
        self.listener = tf2_ros.TransformListener(self.buffer, self)
        # The one must not keep the other from running while it awaits.
        group = ReentrantCallbackGroup()
        self.service = self.create_service(
            Trigger, "where_is_the_gripper", self.on_request, callback_group=group
        )
        self.asked, self.waits = Future(), Future()
        self.docked = Future()
        self.timer = self.create_timer(0.01, self.on_timer, callback_group=group)

    async def on_request(self, request, response):
        self.asked.set_result(True)
        found = await self.buffer.lookup_transform_async("base_link", "gripper", Time())
        position = found.transform.translation
        response.success = True
        response.message = f"{position.x:.2f} {position.y:.2f} {position.z:.2f}"
        return response

    async def on_timer(self):
        self.timer.cancel()
        print("timer: waiting for the dock")
        self.waits.set_result(True)
        found = await self.buffer.lookup_transform_full_async(
            "base_link", Time(seconds=30), "dock", Time(seconds=20), "odom"
        )
        print("timer: the dock is known in", found.header.frame_id)
        self.docked.set_result(round(found.transform.translation.x, 3))


def make(parent, child, sec, x, y=0.0, z=0.0):
    t = TransformStamped(child_frame_id=child)
    t.header.frame_id = parent
    t.header.stamp.sec = sec
    t.transform.translation.x, t.transform.translation.y, t.transform.translation.z = x, y, z
    t.transform.rotation.w = 1.0
    return t


def main():
    rclpy.init()
    locator, robot = Locator(), Node("robot")
    broadcaster = tf2_ros.TransformBroadcaster(robot)
    static_broadcaster = tf2_ros.StaticTransformBroadcaster(robot)
    client = robot.create_client(Trigger, "where_is_the_gripper")
    executor = SingleThreadedExecutor()
    executor.add_node(locator)
    executor.add_node(robot)

    def until(future):
        executor.spin_until_future_complete(future, timeout_sec=60.0)
        assert future.done(), "it took too long"
        return future.result()

    def until_true(condition):
        future = Future()
        timer = robot.create_timer(
            0.01, lambda: condition() and not future.done() and future.set_result(True)
        )
        until(future)
        robot.destroy_timer(timer)

    until(locator.waits)
    until_true(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    until(locator.asked)
    print("answered before the transform:", answer.done())

    static_broadcaster.sendTransform(make("wrist", "gripper", 0, 0.1, z=0.05))
    until_true(lambda: broadcaster.pub_tf.get_subscription_count() == 1)
    print("answered with one half of it:", answer.done())
    broadcaster.sendTransform(make("base_link", "wrist", 7, 0.5, y=-0.25))
    print("answer:", until(answer).message)

    broadcaster.sendTransform(make("odom", "dock", 20, 4.0))
    broadcaster.sendTransform(make("odom", "base_link", 20, 1.0))
    broadcaster.sendTransform(make("odom", "base_link", 40, 3.0))
    print("meters to the dock:", until(locator.docked))

    executor.shutdown()
    locator.destroy_node()
    robot.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
