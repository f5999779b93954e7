# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Ends a listener, its node and its context in every order, many times: nothing is left of them.

Arguments: "spun": a thread of the listener spins the node; or "not spun". How often they end, after once in
every order. An end that hangs raises SIGALRM after END_S.
"""

import gc
import itertools
import os
import re
import signal
import sys
import weakref
from contextlib import suppress
from pathlib import Path

import rclpy
from waiting import DEADLINE_S, until

import tf2_ros

END_S = round(DEADLINE_S / 2)


class Silent(tf2_ros.TransformListener):
    def __del__(self):
        """Do not call that of the base."""


def threads():
    """
    How many threads there are, without those that the middleware starts and ends at any time: Zenoh's pool,
    and Fast DDS's thread for its log, which begins with the first message, for example about a port of
    shared memory that another process has just locked.
    """
    names = []
    for task in Path("/proc/self/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended
            names.append((task / "comm").read_text())
    return sum(re.match(r"((net|rx|tx)-\d+|dds\.log)$", name) is None for name in names)


def files():
    return len(os.listdir("/proc/self/fd"))


def live_and_end(order, name, kind, spin_thread):
    context = rclpy.Context()
    context.init(args=[])
    node = rclpy.create_node(name, context=context)
    buffer = tf2_ros.Buffer(node=node)
    buffer.node = node  # a program's own ways from the buffer to the node keep nothing alive
    listener = kind(buffer, node, spin_thread=spin_thread)
    references = [weakref.ref(thing) for thing in (node, buffer, listener, listener._tf2_state.receiver)]
    for what in order:
        if what == "unregister":
            listener.unregister()
        elif what == "node":
            node.destroy_node()
        elif what == "context":
            context.shutdown()
        else:
            break
    return references, context.handle


def are_gone(references):
    gc.collect()
    return not any(reference() for reference in references)


def main(is_spun, ends):
    orders = list(itertools.permutations(["unregister", "node", "context", "drop"]))
    kinds = itertools.cycle([tf2_ros.TransformListener, tf2_ros.TransformListener, Silent])
    if is_spun:
        # As long as its context lives, a node that is spun is not garbage.
        orders = [order for order in orders if order.index("context") < order.index("drop")]
        kinds = itertools.repeat(tf2_ros.TransformListener)
    names = (f"passing_{n}" for n in itertools.count())

    def all_orders():
        for order in orders:
            signal.alarm(END_S)
            references, context_handle = live_and_end(order, next(names), next(kinds), is_spun)
            until(lambda found=references: are_gone(found))
            if context_handle.ok():
                context_handle.shutdown()  # at the next signal, rclpy would use the context after its end

    all_orders()
    before = threads(), files()
    for _ in range(ends // len(orders)):
        all_orders()
    signal.alarm(0)
    until(lambda: threads() <= before[0] and files() <= before[1])
    print("nothing is left")


main(sys.argv[1] == "spun", int(sys.argv[2]))
