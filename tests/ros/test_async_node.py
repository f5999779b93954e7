"""Listeners of rclpy's AsyncNode, whose messages an asyncio loop takes."""

import asyncio

import pytest
from async_nodes import AsyncNode
from making import at, translation
from processes import DEADLINE_S

pytestmark = pytest.mark.ours

S = 1_000_000_000


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer()


def in_a_loop(coroutine):
    """Run a coroutine to its end, and return what it returns."""

    async def limited():
        return await asyncio.wait_for(coroutine, DEADLINE_S)

    return asyncio.run(limited())


def test_what_the_loop_takes_is_inserted_and_completes_what_it_awaits(tf2_ros, ros, buffer, peer):
    publisher = peer()

    async def look_up():
        async with AsyncNode("asynchronous") as node:
            with tf2_ros.TransformListener(buffer, node):
                waiting = asyncio.ensure_future(buffer.lookup_transform_async("map", "robot", at(2)))
                publisher.send(("map", "robot", 2 * S, 7))
                return await waiting

    assert translation(in_a_loop(look_up()))[0] == 7


def test_a_listener_that_ends_leaves_no_subscription(tf2_ros, ros, buffer):
    async def topics():
        async with AsyncNode("asynchronous") as node:
            listener = tf2_ros.TransformListener(buffer, node)
            before = node.get_subscriber_names_and_types_by_node("asynchronous", "/")
            listener.unregister()
            after = node.get_subscriber_names_and_types_by_node("asynchronous", "/")
            return [{topic for topic, _ in listed} & {"/tf", "/tf_static"} for listed in (before, after)]

    assert in_a_loop(topics()) == [{"/tf", "/tf_static"}, set()]


def test_a_listener_that_is_given_no_node_needs_no_loop(tf2_ros, ros, buffer, peer):
    """It spins a node of its own."""
    publisher = peer()

    async def look_up():
        async with AsyncNode("asynchronous"):
            with tf2_ros.TransformListener(buffer):
                waiting = asyncio.ensure_future(buffer.lookup_transform_async("map", "robot", at(2)))
                publisher.send(("map", "robot", 2 * S, 8))
                return await waiting

    assert translation(in_a_loop(look_up()))[0] == 8
