# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Faults of rclpy, of the middleware below it, and of Python, known by whose code raised or hangs.

Nothing but such a fault makes a test try anything again, and pytest's summary of warnings names each.
"""

import re
import sys
import traceback
import warnings
from pathlib import Path

import pytest
import reference

ATTEMPTS = 3
# Of tests in which signal handlers raise.
WITHOUT_LOCKS_LEFT = pytest.mark.skipif(
    sys.version_info >= (3, 14), reason="CPython 3.14 leaves a lock locked if a signal raises in its `with`"
)


class KnownFault(UserWarning):
    """A fault that a test met, and went on."""


def tried(attempt):
    """
    What `attempt` returns, with the standard error of a program as `stderr`.

    It is called again where that shows a fault; what it returns the third time is returned in any case.
    """
    for _ in range(ATTEMPTS):
        done = attempt()
        fault = fault_in(done.stderr)
        if fault is None:
            break
        warnings.warn(KnownFault(fault), stacklevel=2)
    return done


def accept(error):
    """Go on after an exception that rclpy raised by itself; raise any other one."""
    *_, last = traceback.extract_tb(error.__traceback__)
    if not _is_of_rclpy(last.filename):
        raise error
    warnings.warn(KnownFault(f"{type(error).__name__} raised in rclpy's {last.name}"), stacklevel=2)


def fault_in(errors):
    """The fault that the standard error of a program shows, in a few words; None: it shows none."""
    faults = (
        _dropped_answer(errors),
        _lost_response(errors),
        _error_of_rclpy(errors),
        _hang_of_fast_dds(errors),
        _hung_end_of_fast_dds(errors),
    )
    return next(filter(None, faults), None)


def _is_of_rclpy(path):
    return "rclpy" in Path(path).parts


def _dropped_answer(errors):
    # The middleware drops an answer to a client that it does not know within 0.1 s, on a busy machine.
    for path, text in re.findall(r"^(.+):\d+: RuntimeWarning: (failed to send response .*)$", errors, re.M):
        if _is_of_rclpy(path):
            return text
    return None


def _lost_response(errors):
    # Its action client loses a response that arrives before the thread that sent the request has returned.
    # tf2's BufferClient sends in another thread than the executor's; in this project, that would be a fault.
    if reference.release is None:
        return None
    lost = re.search(r"Ignoring unexpected (goal|result) response", errors)
    return f"rclpy's action client lost a {lost[1]} response" if lost else None


def _error_of_rclpy(errors):
    # Ctrl-C leaves rclpy in some instants with errors of its own: its bindings cannot convert an argument, or
    # a task whose constructor has not come to its end is destroyed.
    raised = []  # where, and what
    for text in re.split(r"^ *Traceback \(most recent call last\):\n", errors, flags=re.M)[1:]:
        frames, error = re.match(r"((?: .*\n)*)(.*)", text).groups()
        if not error.startswith("KeyboardInterrupt"):
            *_, path = "", *re.findall(r'File "(.+)", line', frames)
            raised.append((path, error))
    if raised and all(_is_of_rclpy(path) for path, _ in raised):
        return f"raised in rclpy: {raised[-1][1]}"
    return None


def _hang_of_fast_dds(errors):
    # A lock that a thread of the parent had is locked for ever in a forked child.
    subscribes = r'^Timeout .*first\):\n  File "([^"]+)", line \d+ in _?create_subscription$'
    hung = re.search(subscribes, errors, re.M | re.S)
    return "a forked child hangs in Fast DDS as it subscribes" if hung and _is_of_rclpy(hung[1]) else None


def _hung_end_of_fast_dds(errors):
    # A participant that ends has a lock and waits until no thread calls its listener, and a thread that is
    # about to report another participant's publisher to the listener waits for the lock. The stack is in C.
    ends = r"DomainParticipant\d+set_listener.*\n(.*\n)*?.*rmw_fastrtps_shared_cpp\d+destroy_participant"
    return "a participant hangs in Fast DDS as it ends" if re.search(ends, errors) else None
