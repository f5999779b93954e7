# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls as programs make them, with a timeout or an option, awaited, with the answer available and not."""

import asyncio
from time import perf_counter_ns

import numpy as np
from call_texts import AVAILABLE, CALLS, EMPTY
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from rclpy.time import Time
from trees_and_queries import Tree, chain

import tf2_geometry_msgs  # noqa: F401  transforms PointStamped
from tf2_ros import TransformException

HOPS = 4
SAMPLES = 300  # per frame

LOOP = """
{kind} loop(turns, clock, add, {names}):
    for _ in turns:
        start = clock()
        try:
            {call}
        except TransformException:
            pass
        add(clock() - start)
"""
COUNTED = """
{kind} loop(turns, {names}):
    for _ in turns:
        try:
            {call}
        except TransformException:
            pass
"""


def looping(call, text, names):
    """A function that makes a call in turns, with objects of these names; its text is as in a program."""
    scope = {"TransformException": TransformException}
    kind = "async def" if call.startswith("await") else "def"
    exec(text.format(kind=kind, call=call, names=", ".join(names)), scope)
    if kind == "def":
        return scope["loop"]
    return lambda *arguments, **objects: asyncio.run(scope["loop"](*arguments, **objects))


def objects_of(call, library):
    """What a call names, with the buffer filled for it."""
    tree = chain("chain", HOPS, SAMPLES)
    if call in AVAILABLE:
        tree = Tree("static", tree.parents, [False] * (HOPS + 1), 0)
    library.load(tree)
    point = PointStamped()
    point.header.frame_id = tree.names[HOPS]
    return {
        "buffer": library.buffer,
        "target": tree.names[0],
        "source": tree.names[HOPS],
        "fixed": tree.names[1],
        "unknown": "unknown",
        "time": Time(),
        "newer": Time(nanoseconds=tree.newest_ns + 10**9),
        "duration": Duration(seconds=1),
        "none": Duration(nanoseconds=0),
        "point": point,
    }


def calls(rows, sizes, library):
    """Each call that the library has."""
    for call in CALLS:
        objects = objects_of(call, library)
        empty, times = [], []
        looping(EMPTY, LOOP, objects)(range(1000), perf_counter_ns, empty.append, **objects)
        loop = looping(call, LOOP, objects)
        try:
            loop(range(sizes.warm_up), perf_counter_ns, times.append, **objects)
        except (AttributeError, TypeError):
            continue  # it takes no number as a timeout, or no option
        times.clear()
        loop(range(sizes.calls), perf_counter_ns, times.append, **objects)
        rows.add("call", {"call": call}, np.array(times) - np.median(empty))
