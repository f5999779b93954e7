"""The asynchronous iteration of message filters, by several consumers at once."""

import asyncio
import gc
import signal
import subprocess
import sys
import threading

import pytest
from geometry_msgs.msg import PointStamped
from processes import DEADLINE_S, start
from rclpy.executors import SingleThreadedExecutor

from tf2_ros._wait.filter_queue import MessageStream

pytestmark = pytest.mark.ours


def new_stream():
    return MessageStream(lambda: False)


def test_a_consumer_that_begins_to_wait_while_others_are_woken_is_woken_next():
    stream = new_stream()
    assert not stream._awaiting
    begin_to_wait = stream._awaiting.append  # as a thread that is interrupted at this point
    stream.put("for another")
    assert stream._items.popleft() == "for another"
    woken = []

    class Arrival:
        def set_result(self, _):
            woken.append(self)

    begin_to_wait(Arrival())
    stream.put("for this one")
    assert len(woken) == 1


def test_consumers_in_several_threads_get_each_item_once_and_all_end():
    stream, consumers, items = new_stream(), 4, 2000
    got = [[] for _ in range(consumers)]

    async def take(own):
        async for item in stream:
            own.append(item)

    threads = [threading.Thread(target=asyncio.run, args=(take(own),), daemon=True) for own in got]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for item in range(items):
            stream.put(item)
        stream.close()
        for thread in threads:
            thread.join(DEADLINE_S)
    finally:
        sys.setswitchinterval(interval)
    assert not any(thread.is_alive() for thread in threads), "a consumer is stranded"
    assert sorted(sum(got, [])) == list(range(items))


def test_a_consumer_that_leaves_takes_nothing_with_it():
    async def main():
        stream = new_stream()
        leaving = [asyncio.ensure_future(stream.__anext__()) for _ in range(3)]
        staying = asyncio.ensure_future(stream.__anext__())
        await asyncio.sleep(0)
        for one in leaving:
            one.cancel()
        stream.put("item")
        assert await asyncio.wait_for(staying, DEADLINE_S) == "item"
        assert not stream._awaiting

    asyncio.run(main())


def test_a_task_that_nobody_refers_to_goes_on(tf2_ros, node):
    seen = []

    async def main(filter, executor):
        async def follow():
            async for message, _ in filter:
                seen.append(message)

        asyncio.create_task(follow())
        await asyncio.sleep(0)
        gc.collect()
        message = PointStamped()
        message.header.frame_id = "map"
        filter.add(message)
        while not seen:
            executor.spin_once(timeout_sec=0)
            await asyncio.sleep(0)

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with tf2_ros.MessageFilter(None, tf2_ros.Buffer(), "map", 0, node=node) as filter:
        asyncio.run(asyncio.wait_for(main(filter, executor), DEADLINE_S))
    executor.shutdown()


class TestShutdown:
    @pytest.fixture
    def filter(self, tf2_ros, node):
        filter = tf2_ros.MessageFilter(None, tf2_ros.Buffer(), "map", 0, node=node)
        yield filter
        filter.close()

    @pytest.mark.parametrize("how", ["shutdown", "node"])
    def test_it_ends_an_iteration_and_those_that_begin_later(self, filter, ros, node, how):
        async def take_all():
            return [item async for item in filter]

        async def main():
            taking = [asyncio.ensure_future(take_all()) for _ in range(2)]
            await asyncio.sleep(0)
            (ros.shutdown if how == "shutdown" else node.destroy_node)()
            taking.append(take_all())
            return await asyncio.wait_for(asyncio.gather(*taking), DEADLINE_S)

        assert asyncio.run(main()) == [[], [], []]

    def test_what_was_put_in_before_comes_first(self):
        async def main():
            stream = MessageStream(lambda: True)
            stream.put("item")
            return [item async for item in stream]

        assert asyncio.run(main()) == ["item"]

    def test_a_signal_that_shuts_the_context_down_ends_it(self):
        program = start("iterates.py", stdout=subprocess.PIPE)
        assert program.stdout.readline() == "waiting\n"
        program.send_signal(signal.SIGTERM)
        text, _ = program.communicate(timeout=DEADLINE_S)
        assert text == "ended\n"
