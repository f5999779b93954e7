#!/usr/bin/env python3
# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A service whose callback blocks in a lookup with a timeout, while other threads of the executor receive."""

from threading import Event, Thread

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from std_srvs.srv import SetBool

from tf2_ros import Buffer, LookupException, TransformBroadcaster, TransformListener

rclpy.init()
node = rclpy.create_node("arm_server")
buffer = Buffer(cache_time=Duration(seconds=30))
listener = TransformListener(buffer, node)
broadcaster = TransformBroadcaster(node)
inside = Event()


def handle(request, response):
    """Data true: be patient. False: wait only a moment."""
    inside.set()
    patience = Duration(seconds=60) if request.data else Duration(seconds=0.2)
    try:
        found = buffer.lookup_transform("arm_base", "tool", rclpy.time.Time(), timeout=patience)
    except LookupException as error:
        response.success, response.message = False, type(error).__name__
    else:
        response.success, response.message = True, f"tool at z = {found.transform.translation.z:.1f} m"
    return response


node.create_service(SetBool, "find_tool", handle, callback_group=MutuallyExclusiveCallbackGroup())
client_node = rclpy.create_node("arm_client")
client = client_node.create_client(SetBool, "find_tool")
executor = MultiThreadedExecutor(num_threads=4)
for one in (node, client_node):
    executor.add_node(one)


ending = Event()


def spin():
    while not ending.is_set():
        executor.spin_once(timeout_sec=0.1)


thread = Thread(target=spin)
thread.start()
if not client.wait_for_service(timeout_sec=60.0):
    raise SystemExit("no service")

# Nobody has published a transform yet.
answer = client.call(SetBool.Request(data=False))
print("impatient:", answer.success, answer.message)

inside.clear()
replies = []
caller = Thread(target=lambda: replies.append(client.call(SetBool.Request(data=True))))
caller.start()
if not inside.wait(60.0):
    raise SystemExit("nobody asked")
lifted = TransformStamped()
lifted.header.frame_id, lifted.child_frame_id = "arm_base", "tool"
lifted.header.stamp = node.get_clock().now().to_msg()
lifted.transform.translation.z = 1.5
lifted.transform.rotation.w = 1.0
for _ in range(600):  # listeners may be discovered late
    broadcaster.sendTransform(lifted)
    caller.join(0.1)
    if not caller.is_alive():
        break
print("patient:", replies[0].success, replies[0].message)

# And once more, when there is nothing to wait for.
answer = client.call(SetBool.Request(data=False))
print("now:", answer.success, answer.message)

ending.set()
thread.join()
executor.shutdown()
rclpy.try_shutdown()
