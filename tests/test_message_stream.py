"""The asynchronous iteration of message filters, by several consumers at once."""

import asyncio
import sys
import threading

import pytest
from processes import DEADLINE_S

from tf2_ros._wait.message_stream import MessageStream

pytestmark = pytest.mark.ours


def test_a_consumer_that_begins_to_wait_while_others_are_woken_is_woken_next():
    stream, awaiting = MessageStream(), MessageStream()._awaiting
    assert not awaiting
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
    stream, consumers, items = MessageStream(), 4, 2000
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
        stream = MessageStream()
        leaving = [asyncio.ensure_future(stream.__anext__()) for _ in range(3)]
        staying = asyncio.ensure_future(stream.__anext__())
        await asyncio.sleep(0)
        for one in leaving:
            one.cancel()
        stream.put("item")
        assert await asyncio.wait_for(staying, DEADLINE_S) == "item"
        assert not stream._awaiting

    asyncio.run(main())
