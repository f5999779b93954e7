"""A buffer server that does what a goal's target frame orders; named by its argument, ends with its input."""

import sys
import threading

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor

from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error


class Server:
    def __init__(self, node, action):
        self.cancelled = threading.Event()
        self.server = ActionServer(
            node,
            LookupTransform,
            action,
            self.execute,
            goal_callback=self.judge,
            cancel_callback=self.cancel,
            callback_group=ReentrantCallbackGroup(),
        )

    def judge(self, goal):
        return GoalResponse.REJECT if goal.target_frame == "rejected" else GoalResponse.ACCEPT

    def cancel(self, handle):
        self.cancelled.set()
        return CancelResponse.ACCEPT

    def execute(self, handle):
        goal, result = handle.request, LookupTransform.Result()
        if goal.target_frame == "silent":
            self.cancelled.wait()
            print("cancelled", flush=True)
            handle.canceled()
        elif goal.target_frame == "too late":
            handle.abort()
        elif goal.target_frame == "empty":
            handle.succeed()
        elif goal.target_frame.endswith("_ERROR"):
            result.error.error = getattr(TF2Error, goal.target_frame)
            result.error.error_string = f"this is a {goal.target_frame}"
            # As the reference: at once it is a success, after waiting an abortion.
            handle.abort() if goal.timeout.sec else handle.succeed()
        else:
            self.answer(goal, result.transform)
            handle.succeed()
        return result

    def answer(self, goal, transform):
        transform.header.frame_id = goal.target_frame
        transform.header.stamp = goal.target_time if goal.advanced else goal.source_time
        transform.child_frame_id = " ".join(filter(None, [goal.source_frame, goal.fixed_frame]))
        transform.transform.translation.x = goal.source_time.sec + goal.source_time.nanosec * 1e-9
        transform.transform.translation.y = goal.timeout.sec + goal.timeout.nanosec * 1e-9


def main():
    rclpy.init()
    node = rclpy.create_node("lookup_server")
    server = Server(node, sys.argv[1])
    executor = MultiThreadedExecutor(3)
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    print("ready", flush=True)
    sys.stdin.read()
    server.cancelled.set()
    executor.create_task(executor.shutdown)
    spinning.join()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
