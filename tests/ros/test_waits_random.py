# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Waits of all kinds that begin and end in any order, in several threads: each ends, and leaves nothing."""

import asyncio
import gc
import random
import threading
import weakref
from collections import Counter

import pytest
from helper_threads import let_helper_threads_finish
from random_runs import seeds
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from rclpy.time import Time
from spinning_nodes import spinning
from times_and_transforms import S, at_ns, transform
from waiting import DEADLINE_S, until

from tf2_py import BufferCore
from tf2_ros._process.background import background

THREADS = 4
STEPS = 1500  # of each thread
MOST_TIMEOUT_NS = 5_000_000
FRAMES = [f"f{i}" for i in range(6)]
OWN = ("a callback's own",)  # what comes out of whatever completes its future
STAMPS_NS = range(1 * S, 9 * S, S // 4)


class Player:
    """One thread, and what it holds."""

    def __init__(self, seed, buffer, executor):
        self.random = random.Random(seed)
        self.buffer = buffer
        self.executor = executor
        self.held = []
        self.tasks = []
        self.begun = []  # weakly; all futures
        self.ends = Counter()  # of those with a callback
        self.errors = []

    def play(self):
        for _ in range(STEPS):
            try:
                self.random.choice(self.MOVES)(self)
            except BaseException as error:
                if error.args != OWN:
                    self.errors.append(error)

    def question(self):
        time = self.random.choice([Time(), at_ns(self.random.choice(STAMPS_NS))])
        return self.random.choice(FRAMES), self.random.choice(FRAMES), time

    def timeout(self):
        return self.random.choice([None, Duration(nanoseconds=self.random.randrange(MOST_TIMEOUT_NS))])

    def begin(self):
        future = self.buffer.wait_for_transform_async(*self.question(), timeout=self.timeout())
        self.held.append(future)
        self.begun.append(weakref.ref(future))

    def begin_full(self):
        target, source, time = self.question()
        future = self.buffer.wait_for_transform_full_async(
            target, time, source, at_ns(self.random.choice(STAMPS_NS)), FRAMES[0], timeout=self.timeout()
        )
        self.held.append(future)
        self.begun.append(weakref.ref(future))

    def add_callback(self):
        if self.held:
            self.random.choice(self.held).add_done_callback(self.random.choice(self.CALLBACKS).__get__(self))

    def count(self, future):
        error = None if future.cancelled() else future.exception()
        self.ends["cancelled" if future.cancelled() else type(error).__name__] += 1

    def raise_in_callback(self, _):
        raise self.random.choice([RuntimeError, asyncio.CancelledError])(*OWN)

    def wait_in_callback(self, _):
        self.buffer.can_transform(*self.question(), Duration(nanoseconds=100_000))

    def cancel(self):
        if self.held:
            self.random.choice(self.held).cancel()

    def drop(self):
        if self.held:
            self.held.pop(self.random.randrange(len(self.held)))

    def insert(self):
        parent, child = self.random.sample(FRAMES, 2)
        self.put(transform(parent, child, ns=self.random.choice(STAMPS_NS)))

    def insert_along(self):
        """So that the frames are connected now and then."""
        stamp_ns = self.random.choice(STAMPS_NS)
        for parent, child in zip(FRAMES, FRAMES[1:], strict=False):
            self.put(transform(parent, child, ns=stamp_ns))

    def put(self, message):
        is_static = self.random.random() < 0.02
        (self.buffer.set_transform_static if is_static else self.buffer.set_transform)(message, "me")

    def forget(self):
        if self.random.random() < 0.5:
            self.buffer.clear()
        else:
            BufferCore.__init__(self.buffer)

    def block(self):
        self.buffer.can_transform(*self.question(), Duration(nanoseconds=self.random.randrange(3_000_000)))

    def begin_task(self):
        if len(self.tasks) < 30:
            self.tasks.append(self.executor.create_task(self.ask()))

    async def ask(self):
        try:
            await self.buffer.lookup_transform_async(
                *self.question(), timeout=Duration(nanoseconds=2_000_000)
            )
        except Exception as error:
            return type(error)

    def run_asyncio(self):
        async def main():
            asking = asyncio.gather(*(self.ask() for _ in range(3)))
            if self.random.random() < 0.5:
                asking.cancel()
            await asyncio.gather(asking, return_exceptions=True)

        asyncio.run(main())

    def check(self):
        self.buffer._self_check()

    CALLBACKS = (count, count, raise_in_callback, wait_in_callback)
    MOVES = (
        *(begin, begin_full, add_callback, add_callback, cancel, drop, drop, insert, insert_along),
        *(forget, block, begin_task, run_asyncio, check),
    )


@pytest.mark.parametrize("seed", seeds(4))
def test_each_ends_and_leaves_nothing(tf2_ros, ros, seed):
    buffer = tf2_ros.Buffer()
    executor = MultiThreadedExecutor(3)
    players = [Player(10 * seed + i, buffer, executor) for i in range(THREADS)]
    with spinning(executor):
        threads = [threading.Thread(target=player.play, daemon=True) for player in players]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(3 * DEADLINE_S)
        assert not any(thread.is_alive() for thread in threads), "a player hangs"
        assert [player.errors for player in players] == [[]] * THREADS
        tasks = [task for player in players for task in player.tasks]
        until(lambda: all(task.done() for task in tasks))
        tasks.clear()
    buffer._self_check()
    let_helper_threads_finish(MOST_TIMEOUT_NS)
    begun = [reference for player in players for reference in player.begun]
    for reference in begun:
        end(reference())
    assert buffer.statistics()["waiters"] == 0, "a wait goes on that nobody waits for"
    assert not buffer._tf2_kept
    ends = sum((player.ends for player in players), Counter())
    assert ends.keys() == {"cancelled", "NoneType", "TimeoutException"}, "the game is too simple"
    for player in players:
        player.held.clear()
        player.tasks.clear()
        player.buffer = None
    executor.shutdown()
    gone = weakref.ref(buffer)
    del buffer, executor, players, player, threads
    until(lambda: gc.collect() is not None and gone() is None)
    until(lambda: gc.collect() is not None and not any(reference() for reference in begun))
    left = [reference() for _, _, reference in background.entries]
    assert not set(left) - {None, background._checks}, "what is over has a timeout"


def end(future):
    if future is not None:
        try:
            future.cancel()
        except asyncio.CancelledError as error:
            assert error.args == OWN
