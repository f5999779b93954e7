"""Comes to its end with something still going on: the first argument says what, the second by which road."""

import sys
import threading

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_ros import Buffer, TransformListener, _receiving


def look(buffer):
    buffer.can_transform("map", "robot", Time(), Duration(seconds=60))


def main(how, road):
    if road == "executor":
        _receiving.Receiver = None
    rclpy.init()
    node = rclpy.create_node("ending")
    buffer = Buffer(node=node)
    if how == "unspun":
        TransformListener(buffer, node)
    elif how == "thread":
        TransformListener(buffer, node, spin_thread=True)
    elif how == "hidden":
        TransformListener(buffer, None)
    elif how == "shutdown":
        TransformListener(buffer, node, spin_thread=True)
        rclpy.shutdown()
    elif how == "waiting":
        TransformListener(buffer, node, spin_thread=True)
        threading.Thread(target=look, args=(buffer,), daemon=True).start()
        while not buffer.statistics()["waiters"]:
            threading.Event().wait(0.001)
    elif how == "future":
        global future
        future = buffer.wait_for_transform_async("map", "robot", Time(), timeout=Duration(seconds=60))
    print("at the end", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
