# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
A node that an asyncio loop runs instead of an executor.

Of a release without AsyncNode, a stand-in shows what holds without what is known of the inside of that class.
"""

import asyncio
import sys
import threading
from functools import partial

import pytest
from async_node_standin import AsyncNode, StandIn
from geometry_msgs.msg import PointStamped
from rclpy.action import ActionServer
from rclpy.exceptions import InvalidHandle
from rclpy.time import Time
from times_and_transforms import S, transform, translation
from waiting import DEADLINE_S

pytestmark = pytest.mark.skipif(sys.version_info < (3, 11), reason="asyncio has no TaskGroup")

LATEST = Time()
IS_REAL = AsyncNode is not StandIn


def in_loop(test):
    """Run a test that is a coroutine function in an event loop."""

    async def run(keywords):
        async with asyncio.timeout(DEADLINE_S):
            await test(**keywords)

    def of_fixtures(ros, tf2_ros, buffer, new_node):
        asyncio.run(run({"tf2_ros": tf2_ros, "buffer": buffer, "sender": new_node("sender")}))

    of_fixtures.__name__, of_fixtures.__doc__ = test.__name__, test.__doc__
    return of_fixtures


async def until(condition):
    """Let the loop work until the condition holds; its value."""
    while not (value := condition()):
        await asyncio.sleep(0.005)
    return value


def point_in(frame):
    point = PointStamped()
    point.header.frame_id = frame
    return point


@in_loop
async def test_a_listener_fills_its_buffer_and_coroutines_await_it(tf2_ros, buffer, sender):
    tf2_ros.StaticTransformBroadcaster(sender).sendTransform(transform("base", "camera", xyz=(1, 2, 3)))
    broadcaster = tf2_ros.TransformBroadcaster(sender)
    async with AsyncNode("listening") as node:
        listener = tf2_ros.TransformListener(buffer, node)
        assert listener.receives == (("/tf", "/tf_static") if IS_REAL else ())
        found = await buffer.lookup_transform_async("base", "camera", LATEST)
        assert translation(found) == (1, 2, 3)
        waiting = asyncio.create_task(buffer.lookup_transform_async("map", "camera", LATEST))
        await until(lambda: sender.count_subscribers("/tf") > 0)
        broadcaster.sendTransform(transform("map", "base", 1.0, (5, 0, 0)))
        assert translation(await waiting) == (6, 2, 3)


@in_loop
async def test_a_callback_of_its_subscription_awaits(tf2_ros, buffer, sender):
    static, points = tf2_ros.StaticTransformBroadcaster(sender), []
    publisher = sender.create_publisher(PointStamped, "points", 10)

    async def on_point(point):
        points.append(await buffer.transform_async(point, "base"))

    async with AsyncNode("listening") as node:
        tf2_ros.TransformListener(buffer, node)
        node.create_subscription(PointStamped, "points", on_point, 10)
        await until(lambda: sender.count_subscribers("points") > 0)
        publisher.publish(point_in("camera"))
        await asyncio.sleep(0)
        assert points == []
        static.sendTransform(transform("base", "camera", xyz=(1, 0, 0)))
        [point] = await until(lambda: points)
        assert (point.header.frame_id, point.point.x) == ("base", 1.0)


@in_loop
async def test_its_loop_runs_all_callbacks(tf2_ros, buffer, sender):
    broadcaster, threads = tf2_ros.TransformBroadcaster(sender), []

    def note(*_):
        threads.append(threading.current_thread())

    async with AsyncNode("listening") as node:
        tf2_ros.TransformListener(buffer, node)
        buffer.on_change("map", "base", note)
        buffer.wait_for_transform_async("map", "base", LATEST).add_done_callback(note)
        with tf2_ros.MessageFilter((PointStamped, "points", 10), buffer, "map", 10, node=node) as waiting:
            waiting.registerCallback(note)
            stream = aiter(waiting)
            publisher = sender.create_publisher(PointStamped, "points", 10)
            await until(lambda: sender.count_subscribers("points") > 0)
            publisher.publish(point_in("base"))
            await until(lambda: waiting.statistics()["waiting"] == 1)
            await until(lambda: sender.count_subscribers("/tf") > 0)
            broadcaster.sendTransform(transform("map", "base", 1.0, (5, 0, 0)))
            message, found = await anext(stream)
            assert (message.header.frame_id, translation(found)) == ("base", (5, 0, 0))
        await until(lambda: len(threads) >= 3)
    assert set(threads) == {threading.current_thread()}


@in_loop
async def test_it_offers_and_uses_a_buffer_server(tf2_ros, buffer, sender):
    buffer.set_transform_static(transform("base", "camera", xyz=(1, 0, 0)), "me")
    async with AsyncNode("serving") as node:
        server = tf2_ros.BufferServer(buffer, node, "lookup")
        client = tf2_ros.BufferClient(node, "lookup")
        found = await client.lookup_transform_async("base", "camera", LATEST)
        assert translation(found) == (1, 0, 0)
        # A blocking lookup needs no loop.
        found = client.lookup_transform("base", "camera", LATEST, DEADLINE_S)
        assert translation(found) == (1, 0, 0)
        client.destroy()
        server.destroy()


@in_loop
async def test_the_thread_of_a_buffer_server_ends_before_its_action(tf2_ros, buffer, sender):
    """An executor of rclpy fails if another thread destroys an action server that it is about to wait for."""
    destroy, threads = ActionServer.destroy, []

    def note_and_destroy(server):
        threads.extend(thread for thread in threading.enumerate() if thread.name == "tf2_ros buffer server")
        destroy(server)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ActionServer, "destroy", note_and_destroy)
        patch.setattr("tf2_ros._nodes.spinner.CALLBACK_END_WAIT_S", DEADLINE_S)
        async with AsyncNode("serving") as node:
            tf2_ros.BufferServer(buffer, node, "lookup").destroy()
    assert threads == []


@in_loop
async def test_a_buffer_follows_its_clock_and_offers_its_service(tf2_ros, buffer, sender):
    async with AsyncNode("listening") as node:
        following = tf2_ros.Buffer(node=node)
        assert following.clock is node.get_clock()
        await until(
            lambda: ("/tf2_frames", ["tf2_msgs/srv/FrameGraph"]) in sender.get_service_names_and_types()
        )
    following.set_transform_static(transform("base", "camera"), "me")
    assert following.can_transform("base", "camera", LATEST)


@in_loop
async def test_its_broadcasters_send(tf2_ros, buffer, sender):
    listener = tf2_ros.TransformListener(buffer, sender)
    async with AsyncNode("sending") as node:
        tf2_ros.StaticTransformBroadcaster(node).sendTransform(transform("base", "camera"))
        broadcaster = tf2_ros.TransformBroadcaster(node)
        await until(lambda: node.count_subscribers("/tf") > 0)
        broadcaster.sendTransform(transform("map", "base", 1.0, (5, 0, 0)))
        await buffer.lookup_transform_async("map", "camera", LATEST)
    listener.unregister()


@in_loop
async def test_reception_iterations_and_queued_futures_end_with_it(tf2_ros, buffer, sender):
    async with AsyncNode("listening") as node:
        listener = tf2_ros.TransformListener(buffer, node)
        await until(lambda: sender.count_subscribers("/tf") == 1)
        stream = aiter(tf2_ros.MessageFilter(None, buffer, "map", 10, node=node))
        step = asyncio.create_task(anext(stream))
        queue = listener._tf2_state.call_queue
        await asyncio.sleep(0)
    assert listener.receives == ()
    with pytest.raises(StopAsyncIteration):
        await step
    queue.put(partial(pytest.fail, "a call was made after the end of the node"))
    await until(lambda: not queue.calls)
    await until(lambda: sender.count_subscribers("/tf") == 0)


@in_loop
async def test_an_unregistered_listener_receives_nothing(tf2_ros, buffer, sender):
    async with AsyncNode("listening") as node:
        with tf2_ros.StaticTransformListener(buffer, node) as listener:
            await until(lambda: sender.count_subscribers("/tf_static") == 1)
        await until(lambda: sender.count_subscribers("/tf_static") == 0)
        assert listener.receives == ()
        listener.unregister()


class Overriding:
    """What a subclass of TransformListener does with each message."""

    def callback(self, data):
        self.seen = True
        super().callback(data)


@in_loop
async def test_the_loop_calls_a_callback_that_is_overridden(tf2_ros, buffer, sender):
    broadcaster = tf2_ros.TransformBroadcaster(sender)
    async with AsyncNode("listening") as node:
        listener = type("Listener", (Overriding, tf2_ros.TransformListener), {})(buffer, node)
        assert listener.receives == ()
        await until(lambda: sender.count_subscribers("/tf") > 0)
        broadcaster.sendTransform(transform("map", "base", 1.0, (5, 0, 0)))
        await buffer.lookup_transform_async("map", "base", LATEST)
        assert listener.seen


@in_loop
async def test_no_thread_can_spin_it(tf2_ros, buffer, sender):
    async with AsyncNode("listening") as node:
        with pytest.raises(
            ValueError, match="spin_thread: expected False for a node that an event loop runs"
        ):
            tf2_ros.TransformListener(buffer, node, spin_thread=True)
        assert sender.count_subscribers("/tf") == 0


@in_loop
async def test_a_destroyed_one_is_refused(tf2_ros, buffer, sender):
    async with AsyncNode("listening") as node:
        pass
    for make in (
        lambda: tf2_ros.TransformListener(buffer, node),
        lambda: tf2_ros.Buffer(node=node),
        lambda: tf2_ros.TransformBroadcaster(node),
        lambda: tf2_ros.MessageFilter(None, buffer, "map", 10, node=node),
        lambda: tf2_ros.BufferClient(node, "lookup"),
        lambda: tf2_ros.BufferServer(buffer, node, "lookup"),
    ):
        with pytest.raises(InvalidHandle, match="the node was destroyed"):
            make()


@in_loop
async def test_one_of_another_loop_or_without_a_loop_is_refused(tf2_ros, buffer, sender):
    def make(kind):
        if kind == "listener":
            tf2_ros.TransformListener(buffer, node)
        else:
            tf2_ros.MessageFilter(None, buffer, "map", 10, node=node)

    async def elsewhere(kind):
        make(kind)

    async with AsyncNode("listening") as node:
        for kind in ("listener", "filter"):
            with pytest.raises(RuntimeError, match=r"\[/listening\] needs an event loop, but none runs"):
                await asyncio.to_thread(make, kind)
            if IS_REAL:
                with pytest.raises(RuntimeError, match=r"\[/listening\] runs in another event loop"):
                    await asyncio.to_thread(asyncio.run, elsewhere(kind))
    assert sender.count_subscribers("/tf") == 0


@in_loop
async def test_what_is_made_before_the_node_runs_works_when_it_does(tf2_ros, buffer, sender):
    """As in a class of a program, whose ``__init__`` makes them, and whose ``run()`` is awaited."""
    broadcaster, called = tf2_ros.TransformBroadcaster(sender), []
    node = AsyncNode("listening")
    tf2_ros.TransformListener(buffer, node)
    buffer.on_change("map", "base", called.append)
    async with node:
        await until(lambda: sender.count_subscribers("/tf") > 0)
        broadcaster.sendTransform(transform("map", "base", ns=1 * S))
        await until(lambda: called)
