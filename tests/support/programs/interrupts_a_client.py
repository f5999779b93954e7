# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interrupt blocking lookups of a BufferClient, each as Ctrl-C does, and go on after each."""

import os
import signal
import threading

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from waiting import until

from tf2_ros import BufferClient


def interrupt_lookups(client):
    until(lambda: client._tf2_goal_sender._pending)
    os.kill(os.getpid(), signal.SIGINT)


for i in range(5):
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.SIGINT)
    node = rclpy.create_node(f"interrupted_{i}", context=context)
    client = BufferClient(node, "none")
    thread = threading.Thread(target=interrupt_lookups, args=[client])
    thread.start()
    try:
        client.lookup_transform("map", "base", Time(), timeout=60)
    except KeyboardInterrupt:
        print("interrupted")
    thread.join()
    client.destroy()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
