# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Forks children after rclpy has installed its signal handlers; each spins a node of its own, and exits."""

import atexit
import os
import sys
import threading

import rclpy

from tf2_ros import Buffer, TransformListener

rclpy.init()
for _ in range(int(sys.argv[1])):
    child = os.fork()
    if child == 0:
        context = rclpy.Context()
        context.init()
        node = rclpy.create_node("child", context=context)
        listener = TransformListener(Buffer(), node, spin_thread=True)
        context.shutdown()
        # What Python does at its exit, without the exit handlers of C++ libraries: with glibc 2.43, spdlog's
        # waits for a thread of the parent, with and without tf2.
        threading._shutdown()
        atexit._run_exitfuncs()
        os._exit(0)
    os.waitpid(child, 0)
rclpy.shutdown()
