# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Do at each line of a call what a signal handler does that interrupts it there."""

import os
import sys

from tf2_ros_tools import live

FOLDER = os.path.dirname(live.__file__)


def interrupt_at_each_line(call, handle, make):
    """
    Call something again and again, each time interrupted at the next line of `tf2_ros_tools.live`.

    :param call: what is called, with what was made.
    :param handle: the handler, called with the same; also afterwards.
    :param make: makes what the call needs, each time.
    :return: how many lines there were.
    """
    lines = 0
    while _is_interrupted(call, handle, make(), lines + 1):
        lines += 1
    return lines


def _is_interrupted(call, handle, made, line):
    left = line

    def trace(frame, event, _):
        nonlocal left
        if os.path.dirname(frame.f_code.co_filename) != FOLDER:
            return None
        if event == "line":
            left -= 1
            if left == 0:
                handle(made)
        return trace

    sys.settrace(trace)
    try:
        call(made)
    except (ConnectionError, TimeoutError):
        pass  # the feed was closed
    finally:
        sys.settrace(None)
        handle(made)
    return left <= 0
