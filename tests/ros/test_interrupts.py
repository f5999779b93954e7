"""A signal handler that raises at a random moment, as Ctrl-C does, leaves nothing that hangs."""

import asyncio
import signal
import subprocess
import threading

import pytest
from processes import DEADLINE_S, start, until
from rclpy.time import Time

pytestmark = pytest.mark.ours

AT = Time(seconds=3)


@pytest.mark.parametrize("how", [[], ["switch"], ["collector", "finalizer"]], ids=lambda how: "-".join(how))
def test_chance_finds_nothing_that_hangs(how):
    """For minutes by hand: ``python tests/support/programs/interrupted.py 600``."""
    program = start("interrupted.py", "3", *how, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    output, _ = program.communicate(timeout=8 * DEADLINE_S)
    assert program.returncode == 0, output
    assert "[]" in output


def test_waits_that_a_signal_handler_begins_end_in_time(tf2_ros):
    """While the main thread begins others, whose entries are swept."""
    buffer, made = tf2_ros.Buffer(), []

    def handle(*_):
        if len(made) < 200:
            made.append(buffer.wait_for_transform_async("map", "nothing", AT, timeout=0.05))

    before = signal.signal(signal.SIGALRM, handle)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.001, 0.0007)
        until(
            lambda: (
                [buffer.wait_for_transform_async("map", "base", AT, timeout=100.0) for _ in range(50)]
                and len(made) == 200
            )
        )
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0, 0)
        signal.signal(signal.SIGALRM, before)
    until(lambda: all(future.done() for future in made))
    for future in made:
        future.exception()


def test_a_program_ends_after_ctrl_c_while_threads_wait():
    program = start("waits_in_two_threads.py", stdout=subprocess.PIPE)
    assert program.stdout.readline() == "ready\n"
    program.send_signal(signal.SIGINT)
    program.wait(DEADLINE_S)


def test_awaits_that_are_cancelled_leave_nothing_on_the_future(tf2_ros):
    buffer = tf2_ros.Buffer()

    async def main():
        future = buffer.wait_for_transform_async("map", "base", AT)

        async def one():
            return await future

        for _ in range(100):
            task = asyncio.ensure_future(one())
            await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        assert future._callbacks == []
        future.cancel()

    asyncio.run(main())


def test_timeouts_end_while_listeners_begin_and_end(tf2_ros, node):
    buffer, done, ending = tf2_ros.Buffer(), [], threading.Event()
    listener = tf2_ros.TransformListener(buffer, node)

    def churn():
        while not ending.is_set():
            tf2_ros.TransformListener(tf2_ros.Buffer(), node).unregister()

    thread = threading.Thread(target=churn)
    thread.start()
    try:
        futures = []
        for _ in range(300):
            futures.append(buffer.wait_for_transform_async("a", "b", AT, timeout=0.001))
            futures[-1].add_done_callback(lambda future: done.append(future.exception()))
        until(lambda: len(done) == 300)
    finally:
        ending.set()
        thread.join()
        listener.unregister()
