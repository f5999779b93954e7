"""The process under test in a soak: all that a node does with transforms, until it is told to end."""

import asyncio
import ctypes
import faulthandler
import gc
import json
import random
import sys
import threading
import time
import traceback

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.time import Time

from reliability.latencies import Latencies
from reliability.soak_traffic import (
    CHAINS,
    DEPTH,
    FIRST_FRAME,
    HOPS,
    LAST_FRAME,
    LINKS,
    PERIOD_NS,
    POINTS,
    STATIC_LINKS,
    STATIC_X,
    S,
    expected_x,
)
from tf2_ros import Buffer, MessageFilter, TimeoutException, TransformException, TransformListener

CACHE_S = 4.0
COUNTED = (
    "lookups",
    "unanswered",
    "expired",
    "answered",
    "cancelled",
    "dropped",
    "probes",
    "lives",
    "filtered",
    "refused",
    "too late",
    "stalls",
)
LOOKUPS_HZ = 200
EXPIRING, EXPIRING_IN_EXECUTOR, AWAITED = 90, 10, 10
FUTURES_HZ = 20  # of each: cancelled, dropped
PROBES_HZ = 20
LIFE_S = 10.0  # of the listener that is restarted
FOR_LONG_S = 60.0
TOLERANCE_M = 1e-6
COLLECT_EVERY = 2  # s, and takes a sample then
STALLED_S, MOST_DUMPS = 10.0, 3  # the executor; then the stack of each thread is printed


class Mallinfo2(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
    ]


_mallinfo2 = ctypes.CDLL(None).mallinfo2
_mallinfo2.restype = Mallinfo2


def stamp_of(answer):
    return answer.header.stamp.sec * S + answer.header.stamp.nanosec


class Node:
    def __init__(self, origin_ns, leak_bytes):
        self.origin_ns = origin_ns
        self.leak_bytes, self.leaked = leak_bytes, []
        self.ending = threading.Event()
        self.problems = []
        self.counts = dict.fromkeys(COUNTED, 0)
        self.latencies = {
            name: Latencies() for name in ("lookup", "publish to answer", "expiry", "insert to answer")
        }
        self.node = rclpy.create_node("soak")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.buffer = Buffer(CACHE_S, self.node)
        self.first = self.buffer.wait_for_transform_async("map", FIRST_FRAME, Time())
        self.filter = MessageFilter(
            (PointStamped, POINTS, QoSProfile(depth=DEPTH)),
            self.buffer,
            "map",
            200,
            node=self.node,
            buffer_timeout=CACHE_S,
        )
        self.filter.registerCallback(self.on_point)
        self.filter.registerFailureCallback(self.on_refused)
        self.listener = TransformListener(self.buffer, self.node, qos=QoSProfile(depth=DEPTH))
        self.second = Buffer(CACHE_S)
        self.probed = Buffer(CACHE_S)
        self.restarted = None
        self.probe_began_ns = 0
        self.spun_at = time.monotonic()
        self.threads = [
            threading.Thread(target=self.guarded, args=(work,), name=work.__name__)
            for work in (self.spin, self.look_up, self.run_loop, self.make_futures, self.probe, self.restart)
        ]

    # What all threads share.

    def guarded(self, work):
        try:
            work()
        except BaseException:
            self.problem(traceback.format_exc())

    def problem(self, text):
        if len(self.problems) < 20:
            self.problems.append(text)
            print(text, file=sys.stderr, flush=True)

    def check(self, answer, hops, static=False):
        stamp_ns = stamp_of(answer)
        wanted = expected_x(stamp_ns, self.origin_ns, hops) + (STATIC_X if static else 0)
        found = answer.transform.translation
        if abs(found.x - wanted) > TOLERANCE_M or found.y != 0 or answer.transform.rotation.w != 1:
            self.problem(f"a wrong answer at {stamp_ns}: {answer}, not x = {wanted}")
        return stamp_ns

    def paced(self, hertz):
        """Once per period, without catching up after a pause of the machine."""
        due = time.monotonic()
        while not self.ending.is_set():
            due = max(due + 1 / hertz, time.monotonic() - 0.1)
            if self.ending.wait(max(0.0, due - time.monotonic())):
                return
            yield

    # The threads.

    def spin(self):
        tasks = [
            self.executor.create_task(self.expire, f"executor{number}", random.Random(number))
            for number in range(EXPIRING_IN_EXECUTOR)
        ]
        while not (self.ending.is_set() and all(task.done() for task in tasks)):
            self.executor.spin_once(timeout_sec=0.1)
            self.spun_at = time.monotonic()

    def look_up(self):
        rng = random.Random(1)
        for _ in self.paced(LOOKUPS_HZ):
            chain, hop = rng.randrange(CHAINS), rng.randrange(HOPS)
            frame, static = f"robot{chain}/{hop}", False
            if rng.random() < 0.2:
                frame, hop, static = f"robot{chain}/camera", HOPS - 1, True
            age_ns = rng.choice((0, 0, rng.randrange(S)))
            stamp_ns = time.monotonic_ns() - PERIOD_NS - age_ns if age_ns else 0
            began_ns = time.monotonic_ns()
            try:
                answer = self.buffer.lookup_transform("map", frame, Time(nanoseconds=stamp_ns))
            except TransformException:
                self.counts["unanswered"] += 1
                continue
            self.latencies["lookup"].add((time.monotonic_ns() - began_ns) / S)
            self.check(answer, hop + 1, static)
            self.counts["lookups"] += 1

    def run_loop(self):
        asyncio.run(self.await_all())

    async def await_all(self):
        works = [self.expire(f"loop{number}", random.Random(number)) for number in range(EXPIRING)]
        works += [self.await_next(random.Random(number)) for number in range(AWAITED)]
        tasks = [asyncio.ensure_future(work) for work in works]
        while not self.ending.is_set():
            await asyncio.sleep(0.1)
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        for task in tasks:
            if not task.cancelled():
                task.result()

    async def expire(self, name, rng):
        """Await transforms that never come, of names that nobody has used before."""
        number = 0
        while not self.ending.is_set():
            timeout_s = rng.uniform(0.5, 1.5)
            began = time.monotonic()
            try:
                await self.buffer.lookup_transform_async(
                    "map", f"never/{name}/{number}", Time(), timeout=timeout_s
                )
            except TimeoutException:
                self.latencies["expiry"].add(time.monotonic() - began - timeout_s)
                self.counts["expired"] += 1
                if self.leak_bytes:
                    self.leaked.append(bytes(self.leak_bytes))
            else:
                self.problem("an answer about a frame that never came")
            number += 1

    async def await_next(self, rng):
        """Await transforms that come soon; about each second one of them."""
        while not self.ending.is_set():
            stamp_ns = time.monotonic_ns() + rng.randrange(S)
            frame = f"robot{rng.randrange(CHAINS)}/{HOPS - 1}"
            was_receiving = self.first.done()
            try:
                answer = await self.buffer.lookup_transform_async(
                    "map", frame, Time(nanoseconds=stamp_ns), timeout=FOR_LONG_S if was_receiving else 1.0
                )
            except TimeoutException:
                if was_receiving and not self.ending.is_set():
                    self.problem(f"no answer about {frame} at {stamp_ns}")
                continue
            self.latencies["publish to answer"].add((time.monotonic_ns() - stamp_ns) / S)
            self.check(answer, HOPS)
            self.counts["answered"] += 1

    def make_futures(self):
        number = 0
        for _ in self.paced(FUTURES_HZ):
            number += 1
            late = Time(nanoseconds=time.monotonic_ns() + 1000 * S)
            cancelled = self.buffer.wait_for_transform_async("map", LAST_FRAME, late, timeout=FOR_LONG_S)
            if number % 2:
                cancelled.add_done_callback(lambda _: None)
            dropped = self.buffer.wait_for_transform_async(f"never/{number}", LAST_FRAME, Time())
            cancelled.cancel()
            if not cancelled.cancelled():
                self.problem("a future was not cancelled")
            del dropped
            self.counts["cancelled"] += 1
            self.counts["dropped"] += 1

    def probe(self):
        """Wait in one thread, insert in another."""
        waiter = threading.Thread(target=self.guarded, args=(self.wait_for_probes,))
        waiter.start()
        message = TransformStampedOf("map", "probe")
        for _ in self.paced(PROBES_HZ):
            number = self.counts["probes"] + 1
            self.probe_began_ns = time.monotonic_ns()
            self.probed.set_transform(message.at(number * S), "soak")
        self.probed.set_transform_static(TransformStampedOf("map", "end").at(0), "soak")
        # Whatever it waits for, it has now.
        self.probed.set_transform(message.at((self.counts["probes"] + 1) * S), "soak")
        waiter.join()

    def wait_for_probes(self):
        while "end" not in self.probed:
            stamp = Time(seconds=self.counts["probes"] + 1)
            self.probed.lookup_transform("map", "probe", stamp, FOR_LONG_S)
            self.latencies["insert to answer"].add((time.monotonic_ns() - self.probe_began_ns) / S)
            self.counts["probes"] += 1

    def on_point(self, point):
        self.counts["filtered"] += 1
        if point.header.frame_id == "nowhere":
            self.problem("a message from nowhere has passed")
        try:
            answer = self.buffer.lookup_transform(
                "map", point.header.frame_id, Time.from_msg(point.header.stamp)
            )
        except TransformException:
            self.counts["unanswered"] += 1  # the machine is busy, and the executor far behind
            return
        self.check(answer, HOPS)

    def on_refused(self, point, reason):
        self.counts["refused" if point.header.frame_id == "nowhere" else "too late"] += 1

    # The listener that is restarted, in all ways.

    def restart(self):
        ways = [self.live_in_executor, self.live_on_own_node, self.live_on_hidden_node, self.live_on_node]
        while not self.ending.is_set():
            way = ways[self.counts["lives"] % len(ways)]
            self.second.clear()
            taken = self.second.statistics()["taken"]
            first = self.second.wait_for_transform_async("map", FIRST_FRAME, Time())
            way()
            # On a busy machine its thread may not have ended when it was unregistered.
            while self.restarted is not None and self.restarted.receives:
                if self.ending.wait(0.01):
                    break
            self.count_life(way.__name__, taken, first)
            self.counts["lives"] += 1

    def live(self, listener):
        """Until it has received from both topics, and for some time."""
        deadline = time.monotonic() + FOR_LONG_S
        while not all(topic.received()[0] for topic in listener._tf2_reception.topics):
            if self.ending.wait(0.05):
                return
            if time.monotonic() > deadline:
                self.problem(f"nothing received within {FOR_LONG_S} s: {listener}")
                return
        self.ending.wait(LIFE_S)

    def new_listener(self, *arguments, **options):
        self.restarted = TransformListener(self.second, *arguments, qos=QoSProfile(depth=DEPTH), **options)
        return self.restarted

    def live_on_node(self):
        listener = self.new_listener(self.node)
        self.live(listener)
        listener.unregister()

    def live_in_executor(self):
        """Made and destroyed by callbacks."""
        made = []
        self.in_executor(lambda: made.append(self.new_listener(self.node)))
        if made:
            self.live(made[0])
            self.in_executor(lambda: made[0].unregister())
            made[0].unregister()

    def in_executor(self, function):
        done = threading.Event()

        def call():
            try:
                function()
            finally:
                done.set()

        self.executor.create_task(call)
        while not done.wait(0.1):
            if self.ending.is_set():
                return

    def live_on_own_node(self):
        # rclpy never frees the service that this leaves out: 107 kB for each node.
        no_service = Parameter("start_type_description_service", value=False)
        node = rclpy.create_node("soak_restarted", parameter_overrides=[no_service])
        with self.new_listener(node, spin_thread=True) as listener:
            self.live(listener)
        node.destroy_node()

    def live_on_hidden_node(self):
        with self.new_listener(None) as listener:
            self.live(listener)

    def count_life(self, way, taken_before, first):
        """All messages from the first to the last one are in the buffer, each once."""
        if not first.done():
            if not self.ending.is_set():
                self.problem(f"{way}: no message within {LIFE_S} s")
            first.cancel()
            return
        newest = {
            stamp_of(self.second.lookup_transform("map", frame, Time()))
            for frame in (FIRST_FRAME, LAST_FRAME)
        }
        messages = (max(newest) - stamp_of(first.result())) // PERIOD_NS + 1
        taken = self.second.statistics()["taken"] - taken_before
        wanted = {messages * len(LINKS) + len(STATIC_LINKS)}
        if self.ending.is_set():  # perhaps before the static ones had arrived
            wanted.add(messages * len(LINKS))
        if len(newest) != 1 or taken not in wanted:
            self.problem(f"{way}: {messages} messages, but {taken} transforms, up to {sorted(newest)}")

    # What it reports about itself.

    def sample(self):
        heap = _mallinfo2()
        return {
            "heap": heap.uordblks + heap.hblkhd,
            "blocks": sys.getallocatedblocks(),
            "waiters": self.buffer.statistics()["waiters"],
            **self.counts,
        }

    def run(self):
        for thread in self.threads:
            thread.start()
        sampler = threading.Thread(target=self.tell_samples)
        sampler.start()
        # From whoever started this: "settled", then "end LAST_NS POINTS"; without, it has ended itself.
        line = sys.stdin.readline().split()
        if line == ["settled"]:
            for one in self.latencies.values():
                one.clear()
            line = sys.stdin.readline().split()
        try:
            if line:
                self.compare(int(line[1]), int(line[2]))
        finally:
            self.ending.set()
            for thread in (*self.threads, sampler):
                thread.join(FOR_LONG_S)
                if thread.is_alive():
                    self.problem(f"thread {thread.name} has not ended")
        self.end()

    def tell_samples(self):
        stalled = False
        for number, _ in enumerate(self.paced(4)):
            if number % (4 * COLLECT_EVERY) == 0:
                # Awaits that expire leave cycles, and the collector of all generations runs twice a minute.
                gc.collect()
                print(json.dumps(self.sample()), flush=True)
            stalled_s = time.monotonic() - self.spun_at
            if stalled_s < STALLED_S:
                stalled = False
            elif not stalled and not self.ending.is_set():
                stalled = True
                self.counts["stalls"] += 1
                if self.counts["stalls"] <= MOST_DUMPS:
                    print(f"at {time.monotonic()} s the executor has stalled:", file=sys.stderr)
                    faulthandler.dump_traceback()

    def compare(self, last_ns, points):
        """What was received with what was sent."""
        try:
            self.buffer.lookup_transform("map", LAST_FRAME, Time(nanoseconds=last_ns), FOR_LONG_S)
        except TransformException as error:
            self.problem(f"the last message has not arrived: {error}")
            return
        messages = (last_ns - stamp_of(self.first.result())) // PERIOD_NS + 1
        taken = self.buffer.statistics()["taken"]
        self.counts["messages"] = messages
        if taken != messages * len(LINKS) + len(STATIC_LINKS):
            self.problem(f"{messages} messages were sent, but {taken} transforms taken")
        deadline = time.monotonic() + FOR_LONG_S
        while (filtered := self.filter.statistics())["received"] < points or filtered["waiting"]:
            if time.monotonic() > deadline:
                self.problem(f"{points} points were sent: {filtered}")
                break
            time.sleep(0.05)

    def end(self):
        self.filter.close()
        self.listener.unregister()
        del self.first
        gc.collect()
        for buffer in (self.buffer, self.second, self.probed):
            buffer._self_check()
            if buffer.statistics()["waiters"]:
                self.problem(f"waiters are left: {buffer.statistics()}")
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()
        left = [
            thread.name
            for thread in threading.enumerate()
            if thread is not threading.main_thread() and not thread.daemon
        ]
        if left:
            self.problem(f"threads are left: {left}")


class TransformStampedOf:
    """One message object, stamped anew."""

    def __init__(self, parent, child):
        from geometry_msgs.msg import TransformStamped

        self._message = TransformStamped(child_frame_id=child)
        self._message.header.frame_id = parent

    def at(self, stamp_ns):
        stamp = self._message.header.stamp
        stamp.sec, stamp.nanosec = divmod(stamp_ns, S)
        return self._message


def main(origin_ns, leak_bytes):
    rclpy.init()
    node = Node(origin_ns, leak_bytes)
    threading.excepthook = lambda what: node.problem("".join(traceback.format_exception(what.exc_value)))
    node.run()
    report = {
        "counts": node.counts,
        "problems": node.problems,
        "latencies": {name: one.summary() for name, one in node.latencies.items()},
    }
    print(json.dumps({"report": report}), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
