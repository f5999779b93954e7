# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One round of a stress run: a buffer, and everything done with it at once."""

import asyncio
import gc
import json
import os
import queue
import random
import signal
import subprocess
import sys
import threading
import time
import traceback

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rclpy.time import Time

from release.child_environment import environment_of_children
from reliability.flagged_builds import ROOT
from reliability.stress_readers import Reader
from reliability.stress_truth import (
    CACHE_S,
    CUP,
    EXACT,
    SENT,
    START_NS,
    STATIC,
    STEP_NS,
    S,
    check_message,
    sample,
)
from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, MessageFilter, TimeoutException, TransformException, TransformListener

READERS, FORKERS = 2, 1
CHILD_S = 60.0  # what a child that does not hang never takes
DONE_S = 20.0  # what a future that was not forgotten never takes
END_S = 60.0
FUTURES = 200  # that one thread has pending
NEVER = 20  # futures of frames that only come at the end
SHORT_S, WAIT_S = 0.02, 0.2
MESSAGES = 50  # that the filter may hold
# rclpy never frees the service that describes types, nor what it keeps for each new name of a node.
WITHOUT_SERVICE = [Parameter("start_type_description_service", value=False)]


class Round:
    """One buffer for some seconds."""

    def __init__(self, seed):
        self.seed = seed
        self.ending = threading.Event()
        self.writers_ended = threading.Event()
        self.problems = []
        self.counts = {}
        self.offered = 0  # transforms, by the writers
        self.received = 0  # messages, by listeners
        self._lock = threading.Lock()
        self._futures = queue.SimpleQueue()
        self.buffer = None

    def __str__(self):
        return f"seed {self.seed}"

    def run(self, seconds):
        """Do it all for so long; what went wrong."""
        threads_before = set(threading.enumerate())
        self.node = rclpy.create_node("stress", parameter_overrides=WITHOUT_SERVICE)
        self.buffer = Buffer(CACHE_S, self.node)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._write(STATIC, static=True)
        self.never = [
            self.buffer.wait_for_transform_async("world", f"never{i}", Time()) for i in range(NEVER)
        ]
        publisher = self._start_publisher()
        writers = [self.write_chain, self.write_bursts, self.write_exact, self.write_cup, self.clear]
        others = [self.read] * READERS + [self.fork] * FORKERS
        others += [self.block, self.make_futures, self.await_all, self.filter, self.listen, self.spin]
        threads = [self._thread(work, i) for i, work in enumerate(writers + others)]
        for thread in threads:
            thread.start()
        time.sleep(seconds)
        self.ending.set()
        for thread in threads:
            thread.join(END_S + CHILD_S)
            if thread.is_alive():
                self._problem(f"{thread.name} has not ended")
                raise SystemExit("\n".join(self.problems))
        self._end_publisher(publisher)
        self._check_statistics()
        self._check_waits()
        self._end(threads_before)
        return self.problems

    # What all threads share.

    def _thread(self, work, number):
        rng = random.Random(f"{self.seed} {work.__name__} {number}")

        def guarded():
            try:
                while not self.ending.is_set():
                    work(rng)
            except BaseException:
                self._problem(f"{work.__name__}: {traceback.format_exc()}")

        return threading.Thread(target=guarded, name=work.__name__)

    def _problem(self, text):
        self.problems.append(text)
        print(text, file=sys.stderr, flush=True)

    def _count(self, what, count=1):
        with self._lock:
            self.counts[what] = self.counts.get(what, 0) + count

    def _write(self, messages, static=False, way=0):
        """Insert in one of all ways."""
        authority = f"writer {way}"
        if way == 0:
            self.buffer.set_transforms(messages, authority, static)
        elif way == 1:
            data = bytes(serialize_message(TFMessage(transforms=messages)))
            self.buffer.set_transforms_cdr(data, authority, static)
        elif way == 3:
            self.buffer.set_transforms(messages, authority, static, replace=True)
        else:
            insert = self.buffer.set_transform_static if static else self.buffer.set_transform
            for message in messages:
                insert(message, authority)
        with self._lock:
            self.offered += len(messages)

    # Writers. One thread writes a frame, so its stamps grow, but for late samples.

    def write_chain(self, rng):
        """A chain of three, with late samples, pauses that prune all, and static ones again."""
        time_ns = START_NS
        while not self.ending.is_set():
            time_ns += STEP_NS if rng.random() < 0.995 else 2 * round(CACHE_S * S)
            self._write([sample(frame, time_ns) for frame in ("a0", "a1", "a2")], way=rng.randrange(4))
            if rng.random() < 0.3:
                late_ns = max(1, time_ns - rng.randrange(round(1.1 * CACHE_S * S)))
                self._write([sample(rng.choice(("a0", "a1", "a2")), late_ns)], way=rng.randrange(4))
            if rng.random() < 0.02:
                self._write([rng.choice(STATIC)], static=True, way=rng.randrange(4))

    def write_bursts(self, rng):
        """Histories that grow to thousands of samples, and shrink to a few."""
        time_ns = START_NS
        while not self.ending.is_set():
            is_dense = rng.random() < 0.5
            step_ns = STEP_NS // 20 if is_dense else 10 * STEP_NS
            for _ in range(30):
                many = [sample("b0", time_ns + i * step_ns) for i in range(40 if is_dense else 2)]
                many += [sample("b1", time_ns + i * step_ns) for i in range(40 if is_dense else 2)]
                if rng.random() < 0.3:
                    rng.shuffle(many)
                self._write(many, way=rng.randrange(3))
                time_ns += step_ns * (len(many) // 2)

    def write_exact(self, rng):
        time_ns = START_NS
        while not self.ending.is_set():
            time_ns += STEP_NS
            self._write([sample(EXACT, time_ns)] * rng.choice((1, 1, 2)), way=rng.randrange(4))

    def write_cup(self, rng):
        time_ns = START_NS
        while not self.ending.is_set():
            time_ns += STEP_NS
            self._write([sample(CUP, time_ns)], way=rng.randrange(3))

    def clear(self, rng):
        if not self.ending.wait(rng.uniform(0.05, 1.0)):
            self.buffer.clear()
            self._count("clears")

    # Readers and waiters.

    def read(self, rng):
        reader = Reader(self.buffer, rng)
        while not self.ending.is_set():
            reader.step()
        for what, count in reader.counts.items():
            self._count(what, count)

    def _soon(self, rng):
        """A lookup that an insert is about to answer."""
        frame = rng.choice((EXACT, CUP, "a0", "a2", "b1", "net2", "camera"))
        try:
            newest_ns = self.buffer.get_latest_common_time("world", frame).nanoseconds
        except TransformException:
            newest_ns = START_NS
        return frame, max(1, newest_ns + rng.randrange(-STEP_NS, 10 * STEP_NS))

    def block(self, rng):
        frame, time_ns = self._soon(rng)
        try:
            answer = self.buffer.lookup_transform("world", frame, time_ns, WAIT_S)
        except TransformException:
            self._count("blocked in vain")
            return
        check_message("world", frame, answer, time_ns)
        self._count("blocked")

    def make_futures(self, rng):
        """Make, cancel, drop and keep them."""
        kept = []
        while not self.ending.is_set():
            frame, time_ns = self._soon(rng)
            future = self.buffer.wait_for_transform_async("world", frame, time_ns)
            fate = rng.random()
            if fate < 0.2:
                future.cancel()
            elif fate < 0.3:
                future.add_done_callback(lambda _: self._count("called back"))
            if fate >= 0.4:
                kept.append((future, frame, time_ns))
            while len(kept) > FUTURES:
                self._check_future(*kept.pop(rng.randrange(len(kept))))
        for one in kept:
            self._futures.put(one)

    def _check_future(self, future, frame, time_ns):
        if not future.done() or future.cancelled():
            self._count("futures without answer")
            return
        check_message("world", frame, future.result(), time_ns)
        self._count("futures answered")

    def await_all(self, rng):
        asyncio.run(self._await_some(rng))

    async def _await_some(self, rng):
        await asyncio.gather(*(self._await_one(rng) for _ in range(20)))

    async def _await_one(self, rng):
        frame, time_ns = self._soon(rng)
        if rng.random() < 0.3:
            frame = "never in this world"
        try:
            answer = await self.buffer.lookup_transform_async("world", frame, time_ns, timeout=SHORT_S)
        except TimeoutException:
            self._count("awaited in vain")
            return
        check_message("world", frame, answer, time_ns)
        self._count("awaited")

    # ROS.

    def filter(self, rng):
        """Give a filter messages that some insert answers; each must pass, or be dropped, exactly once."""
        ended, given = [], 0
        messages = MessageFilter(None, self.buffer, "world", MESSAGES, node=self.node, buffer_timeout=WAIT_S)
        messages.registerCallback(lambda message: ended.append(message))
        messages.registerFailureCallback(lambda message, reason: ended.append(message))
        while not self.ending.is_set() and given < 10 * MESSAGES:
            frame, time_ns = self._soon(rng)
            message = PointStamped()
            message.header.frame_id = frame
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, S)
            messages.add(message)
            given += 1
            self.ending.wait(0.001)
        deadline = time.monotonic() + DONE_S
        while len(ended) < given and not self.ending.is_set() and time.monotonic() < deadline:
            time.sleep(0.001)
        if len(ended) > given or (len(ended) < given and not self.ending.is_set()):
            self._problem(
                f"{given} messages, but {len(ended)} passed or were dropped: {messages.statistics()}"
            )
        self._count("filtered", len(ended))
        messages.close()

    def spin(self, _):
        while not self.ending.is_set():
            self.executor.spin_once(timeout_sec=0.05)

    def listen(self, rng):
        """Make a listener, let it receive, and destroy it."""
        own_node, spins = None, False
        way = rng.randrange(4)
        if way == 0:
            listener = TransformListener(self.buffer, self.node)
        elif way == 1:
            listener = TransformListener(self.buffer, None)
        else:
            own_node = rclpy.create_node("stress_listener", parameter_overrides=WITHOUT_SERVICE)
            spins = way == 2
            listener = TransformListener(self.buffer, own_node, spin_thread=spins)
        topics = listener._tf2_state.topics
        self.ending.wait(rng.uniform(0.1, 1.5))
        receiver = listener._tf2_state.receiver
        if spins:
            listener.__exit__()
        else:
            listener.unregister()
        if receiver is not None and receiver.topics:
            self._problem("a receiver has not ended with its listener")
        received = sum(topic.arrivals.taken()[0] for topic in topics)
        with self._lock:
            self.received += received
        self._count("messages", received)
        self._count("listeners")
        if own_node is not None:
            own_node.destroy_node()
        del listener
        if rng.random() < 0.3:
            gc.collect()

    # Other processes.

    def _start_publisher(self):
        environment = environment_of_children(PYTHONFAULTHANDLER="1")
        return subprocess.Popen(
            [sys.executable, "-m", "reliability.stress_publisher"],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def _end_publisher(self, publisher):
        try:
            said, _ = publisher.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            self._problem("the publisher does not end")
            publisher.send_signal(signal.SIGABRT)
            publisher.communicate()
            return
        if publisher.returncode:
            self._problem(f"the publisher ended with {publisher.returncode}")
            return
        for what, count in json.loads(said).items():
            self._count(f"other process: {what}", count)

    def fork(self, rng):
        child_seed = rng.randrange(10**9)
        child = os.fork()
        if child == 0:
            self._be_child(random.Random(child_seed))
        deadline = time.monotonic() + CHILD_S
        while True:
            pid, status = os.waitpid(child, os.WNOHANG)
            if pid:
                break
            if time.monotonic() > deadline:
                os.kill(child, signal.SIGABRT)
            time.sleep(0.005)
        if status:
            self._problem(f"the child of seed {child_seed} ended with {os.waitstatus_to_exitcode(status)}")
        self._count("children")

    def _be_child(self, rng):
        self._lock = threading.Lock()  # another thread may have held it
        try:
            buffer = self.buffer
            reader = Reader(buffer, rng)
            for _ in range(20):
                reader.step()
            assert not buffer.can_transform("world", "never here", Time(), SHORT_S)
            frame, time_ns = self._soon(rng)
            try:
                check_message(
                    "world", frame, buffer.lookup_transform("world", frame, time_ns, SHORT_S), time_ns
                )
            except TransformException:
                pass
            waiting = buffer.wait_for_transform_async("world", "own", Time())
            mine = sample("camera", START_NS)
            mine.header.frame_id, mine.child_frame_id = "world", "own"
            buffer.set_transform_static(mine, "child")
            _await_done(waiting)
            buffer._self_check()
            if rng.random() < 0.5:
                buffer.clear()
                buffer._self_check()
            mine.child_frame_id = "never0"
            buffer.set_transform_static(mine, "child")
            assert self.never[0].is_dead() or self.never[0].done()
            for _ in range(20):
                reader.step()
            buffer._self_check()
            sys.stderr.flush()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(1)

    # What must be true in the end.

    def _check_statistics(self):
        self.buffer._self_check()
        counts = self.buffer.statistics()
        refused = sum(counts["refused"].values())
        offered = self.offered + self.received * len(SENT)
        if counts["taken"] + refused != offered or refused != counts["refused"]["old_data"]:
            self._problem(f"{offered} transforms were inserted, but: {counts}")
        self._count("inserted", offered)
        self._count("refused", refused)

    def _check_waits(self):
        """Each has its answer, or a lookup has none now; those of NEVER get theirs when it is inserted."""
        pending = 0
        while not self._futures.empty():
            future, frame, time_ns = self._futures.get()
            if not future.done() and not future.cancelled():
                pending += 1
                if self.buffer.can_transform_core("world", frame, time_ns)[0]:
                    self._problem(f"a future of {frame} at {time_ns} still waits")
            self._check_future(future, frame, time_ns)
            future.cancel()
        self._count("futures pending in the end", pending)
        del future
        # Those with callbacks live on without anybody; they are among the dropped ones. One whose answer a
        # listener of this node received is done when the executor has called them.
        deadline = time.monotonic() + DONE_S
        while True:
            waiters = self.buffer.statistics()["waiters"]
            with_callbacks = [one for one in list(self.buffer._tf2_kept) if not one.done()]
            if waiters == NEVER + len(with_callbacks):
                break
            if time.monotonic() > deadline:
                self._problem(f"{waiters} waiters, not {NEVER} and {len(with_callbacks)}")
                break
            self.executor.spin_once(timeout_sec=0.001)
        for one in with_callbacks:
            one.cancel()
        mine = sample("camera", START_NS)
        mine.header.frame_id = "world"
        for i, future in enumerate(self.never):
            if future.done():
                self._problem(f"never{i} has an answer")
            mine.child_frame_id = f"never{i}"
            self._write([mine], static=True, way=i % 3)
            if not future.done():
                self._problem(f"never{i} has no answer")
        if waiters := self.buffer.statistics()["waiters"]:
            self._problem(f"waiters are left: {waiters}")
        self.buffer._self_check()

    def _end(self, threads_before):
        self.executor.shutdown()
        self.node.destroy_node()
        self.buffer = self.node = self.executor = self.never = None
        gc.collect()
        left = {thread.name for thread in set(threading.enumerate()) - threads_before if not thread.daemon}
        if left:
            self._problem(f"threads are left: {left}")


def _await_done(future):
    # At once, unless the thread that follows the parent was about to look the waiters up just then.
    deadline = time.monotonic() + DONE_S
    while not future.done():
        assert time.monotonic() < deadline, "a future was forgotten"
        time.sleep(0.001)
