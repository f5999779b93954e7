# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Look transforms up in the buffer of another process: a BufferServer there, and a BufferClient here.

Run: ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=42 python examples/buffer_server.py
Without the variables (on Humble, ROS_LOCALHOST_ONLY=1 and a domain), it would publish to your whole network.
Ends by itself. The exit status is 0 only if everything succeeded.
"""

import subprocess
import sys
from contextlib import contextmanager

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.time import Time

from tf2_ros import (
    Buffer,
    BufferClient,
    BufferServer,
    LookupException,
    StaticTransformBroadcaster,
    TransformListener,
)

TIMEOUT = Duration(seconds=15)


def main():
    rclpy.init()
    node = rclpy.create_node("client")
    with running_server() as server:
        client = BufferClient(node, "tf2_buffer_server")
        print(f"the server is process {server.pid}, the client waits for it")
        try:
            return ask(node, client)
        finally:
            client.destroy()
            rclpy.try_shutdown()


@contextmanager
def running_server():
    # In a separate session, so that Ctrl-C reaches only this program, which then ends the server.
    command = [sys.executable, __file__, "serve"]
    server = subprocess.Popen(command, start_new_session=True)
    try:
        yield server
    finally:
        server.terminate()
        server.wait()


def serve():
    """What the other process does; the program tf2_buffer_server of tf2-ros-tools does the same."""
    rclpy.init()
    node = rclpy.create_node("tf_buffer")
    buffer = Buffer(node=node)
    with TransformListener(buffer, node):
        server = BufferServer(buffer, node, "tf2_buffer_server")
        try:
            rclpy.spin(node)
        except ExternalShutdownException:
            return 0
        finally:
            server.destroy()


def ask(node, client):
    broadcaster = StaticTransformBroadcaster(node)
    broadcaster.sendTransform(camera())

    # A blocking lookup works although nothing spins the node.
    found = client.lookup_transform("base_link", "camera", Time(), TIMEOUT)
    x = found.transform.translation.x
    print(f"the other process answers: the camera is mounted {x} m ahead")

    can, reason = client.can_transform("base_link", "moon", Time(), return_debug_tuple=True)
    print(f"the moon: {can}, {reason}")
    try:
        client.lookup_transform("base_link", "moon", Time())
    except LookupException:
        return 0 if x == 0.3 and not can else 1
    return 1


def camera():
    """Where the camera is mounted."""
    transform = TransformStamped()
    transform.header.frame_id = "base_link"
    transform.child_frame_id = "camera"
    transform.transform.translation.x = 0.3
    transform.transform.rotation.w = 1.0
    return transform


if __name__ == "__main__":
    try:
        raise SystemExit(serve() if sys.argv[1:] == ["serve"] else main())
    except KeyboardInterrupt:
        raise SystemExit(130) from None
