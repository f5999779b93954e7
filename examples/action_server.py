# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An action server that awaits transforms, and whose clients can cancel a goal while it waits.

Run: ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=42 python examples/action_server.py
Without the variables (on Humble, ROS_LOCALHOST_ONLY=1 and a domain), it would publish to your whole network.
A client in the same program sends two goals: one succeeds, and one is canceled. Ends by itself. The exit
status is 0 only if both ended so.
"""

import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
from rclpy.action.server import ActionServer, CancelResponse, ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from tf2_msgs.action import LookupTransform
from tf2_ros import Buffer


class TransformFinder:
    """Answers the action "find": each goal waits for the transform between two frames."""

    def __init__(self, node: Node, buffer: Buffer) -> None:
        self.buffer = buffer
        self.waiting: dict[bytes, Future] = {}
        # With several threads, goal.canceled() might run before rclpy has marked the goal as canceling.
        group = ReentrantCallbackGroup()
        self.server = ActionServer(
            node, LookupTransform, "find", self.execute, cancel_callback=self.cancel, callback_group=group
        )

    async def execute(self, goal: ServerGoalHandle) -> LookupTransform.Result:
        target, source = goal.request.target_frame, goal.request.source_frame
        future = self.buffer.wait_for_transform_async(target, source, Time(), timeout=60.0)
        self.waiting[bytes(goal.goal_id.uuid)] = future
        try:
            found = await future  # a timeout raises, which aborts the goal
        finally:
            del self.waiting[bytes(goal.goal_id.uuid)]
        if found is None:
            goal.canceled()
            return LookupTransform.Result()
        goal.succeed()
        return LookupTransform.Result(transform=found)

    def cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        future = self.waiting.get(bytes(goal.goal_id.uuid))
        if future is None:
            return CancelResponse.REJECT  # the goal has not begun to wait, or has just ended
        future.cancel()
        return CancelResponse.ACCEPT


def status_of(client: ActionClient, executor: SingleThreadedExecutor, source: str, *, canceled: bool) -> int:
    """Send a goal, cancel it if asked to, and return its final status."""
    goal = LookupTransform.Goal(target_frame="base_link", source_frame=source)
    sending = client.send_goal_async(goal)
    executor.spin_until_future_complete(sending)
    handle = sending.result()
    while canceled:
        canceling = handle.cancel_goal_async()
        executor.spin_until_future_complete(canceling)
        if canceling.result().goals_canceling:  # the goal waits
            break
    ending = handle.get_result_async()
    executor.spin_until_future_complete(ending)
    return ending.result().status


rclpy.init()
node = rclpy.create_node("robot")
buffer = Buffer(node=node)
finder = TransformFinder(node, buffer)
mount = TransformStamped(child_frame_id="camera")
mount.header.frame_id = "base_link"
buffer.set_transform_static(mount, "example")

client = ActionClient(node, LookupTransform, "find")
executor = SingleThreadedExecutor()
executor.add_node(node)
client.wait_for_server()
first = status_of(client, executor, "camera", canceled=False)
print("the goal for the camera succeeded:", first == GoalStatus.STATUS_SUCCEEDED)
second = status_of(client, executor, "nowhere", canceled=True)
print("the goal for a frame that nobody publishes was canceled:", second == GoalStatus.STATUS_CANCELED)
rclpy.shutdown()
if (first, second) != (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED):
    raise SystemExit("a goal ended otherwise")
