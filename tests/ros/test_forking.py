# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A forked child of a process with listeners: what it has of them, and that nothing in it hangs."""

import asyncio
import gc
import re
import sys

import pytest
from excused_faults import tried
from forked_children import in_a_child
from paths import PROGRAMS
from processes import output_of, run
from random_runs import times
from rclpy.time import Time
from rclpy.utilities import get_rmw_implementation_identifier
from times_and_transforms import transform
from waiting import DEADLINE_S

LATEST = Time()
DEAD = "dead in this forked process"


fast_dds_only = pytest.mark.skipif(
    get_rmw_implementation_identifier() != "rmw_fastrtps_cpp",
    reason="a forked child's own node in the domain of its parent's receives nothing",
)


@pytest.mark.parametrize(
    ("what", "count"),
    [
        pytest.param("use", times(8, 20), marks=pytest.mark.repeated),
        pytest.param("drop", times(8, 40), marks=pytest.mark.repeated),
        pytest.param("have_a_node", 1, marks=fast_dds_only),
    ],
)
def test_children_of_a_process_whose_every_thread_is_busy(what, count, flood):
    """In an insert, a vector lookup, a listing, a wait, a callback, the receiver and an executor."""
    flood(500, 20)
    done = tried(lambda: run(sys.executable, PROGRAMS / "forks_while_busy.py", what, count))
    assert (done.returncode, done.stdout) == (0, f"{[0] * count}\n"), done.stderr


def test_a_child_that_spins_a_node_of_its_own_exits():
    """It lacks the thread of rclpy that handles signals, and may have another one in its place."""
    output_of(PROGRAMS / "exits_in_forked_children.py", 6, timeout=DEADLINE_S)


def test_a_child_says_that_its_listeners_receive_nothing(tf2_ros, node, buffer, caplog):
    with tf2_ros.TransformListener(buffer, node) as listener:

        def look():
            [found] = re.findall("forked from a process with (.*). Inherited objects receive no", caplog.text)
            assert re.fullmatch(r"\d+ listeners?", found)
            assert listener.receives == ()

        assert in_a_child(look) == 0
        assert listener.receives
    assert caplog.text == ""


# What a child inherits. `uses` raise there; `ends` do nothing, and all of it goes on in the parent.


def await_it(awaitable):
    async def wait():
        return await awaitable

    return asyncio.run(wait())


def a_future(tf2_ros, node, buffer):
    future = buffer.wait_for_transform_async("map", "robot", LATEST)
    return future, [lambda: await_it(future)], []


def a_listener(tf2_ros, node, buffer):
    listener = tf2_ros.TransformListener(buffer, node)
    uses = [lambda: setattr(listener, "buffer", tf2_ros.Buffer())]
    return (
        listener,
        uses,
        [listener.unregister, listener.__del__, lambda: listener.__exit__(None, None, None)],
    )


def a_listener_with_a_thread(tf2_ros, node, buffer):
    listener = tf2_ros.TransformListener(buffer, None)
    return listener, [], [listener.unregister, listener.__del__]


def a_filter(tf2_ros, node, buffer):
    one = tf2_ros.MessageFilter(None, buffer, "map", 10, node=node)
    stream = one.__aiter__()
    one.add(transform("robot", "arm", 1))
    uses = [
        lambda: one.add(transform("robot", "arm", 1)),
        lambda: one.registerCallback(print),
        lambda: one.clear(),
        one.statistics,
        lambda: await_it(stream.__anext__()),
    ]
    return one, uses, [one.close]


def a_client(tf2_ros, node, buffer):
    client = tf2_ros.BufferClient(node, "nobody")
    uses = [
        lambda: client.lookup_transform("map", "robot", LATEST),
        lambda: await_it(client.lookup_transform_async("map", "robot", LATEST)),
    ]
    return client, uses, [client.destroy]


def a_server(tf2_ros, node, buffer):
    server = tf2_ros.BufferServer(buffer, node, "lookup")
    return server, [], [server.destroy]


def a_broadcaster(tf2_ros, node, buffer):
    both = [tf2_ros.TransformBroadcaster(node), tf2_ros.StaticTransformBroadcaster(node)]
    return both, [lambda one=one: one.sendTransform(transform("map", "robot", 1)) for one in both], []


KINDS = [a_future, a_listener, a_listener_with_a_thread, a_filter, a_client, a_server, a_broadcaster]
SAYS_SO = {a_future, a_listener, a_listener_with_a_thread, a_filter}


@pytest.mark.parametrize("make", KINDS, ids=lambda make: make.__name__)
def test_what_a_child_inherits_is_dead(tf2_ros, node, buffer, make):
    inherited, uses, ends = make(tf2_ros, node, buffer)
    alive = repr(inherited)

    def use_and_drop():
        nonlocal inherited
        buffer.set_transform(transform("map", "robot", 1), "child")
        assert (DEAD in repr(inherited)) == (make in SAYS_SO)
        for use in uses:
            with pytest.raises(RuntimeError, match=DEAD):
                use()
        for end in ends:
            end()
        uses.clear()
        ends.clear()
        inherited = None
        gc.collect()
        assert buffer.can_transform("map", "robot", LATEST)

    assert in_a_child(use_and_drop) == 0
    assert repr(inherited) == alive
    for end in ends:
        end()
