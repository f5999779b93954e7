# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Makes calls in threads of their own: all at the same moment, or each again and again."""

import sys
import threading
from contextlib import contextmanager

from waiting import DEADLINE_S


def at_once(*calls):
    """
    Have a thread for each of these begin it at the same moment, and switch often between them.

    :return: what they return, in order.
    """
    start, results = threading.Barrier(len(calls)), {}

    def run(index):
        start.wait()
        results[index] = calls[index]()

    threads = [threading.Thread(target=run, args=(index,), daemon=True) for index in range(len(calls))]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(DEADLINE_S)
    finally:
        sys.setswitchinterval(interval)
    assert len(results) == len(calls), "one is stranded, or has raised"
    return [results[index] for index in range(len(calls))]


@contextmanager
def repeated(*calls):
    """Have a thread for each of these make it again and again, until the block ends; none may raise."""
    ending, begun, errors = threading.Event(), threading.Barrier(len(calls) + 1), []

    def repeat(call):
        begun.wait()
        try:
            while not ending.is_set():
                call()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=repeat, args=(call,)) for call in calls]
    for thread in threads:
        thread.start()
    begun.wait()
    try:
        yield
    finally:
        ending.set()
        for thread in threads:
            thread.join()
    assert errors == []
