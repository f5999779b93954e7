# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Signals that raise at random moments in waits, filters, listeners and a client; then everything still works.

``interrupts_at_random.py SECONDS [switch | collector | finalizer]``; prints what does not work any more.
"""

import faulthandler
import gc
import random
import signal
import sys
import threading
import time
from contextlib import suppress

import rclpy
from geometry_msgs.msg import PointStamped
from random_runs import first_seed
from rclpy.time import Time
from times_and_transforms import transform
from waiting import DEADLINE_S

from tf2_ros import Buffer, BufferClient, MessageFilter, TransformException, TransformListener
from tf2_ros._process.forking import LOCK

faulthandler.enable()
random.seed(first_seed())


class Interrupt(Exception):
    """What the signal handler raises."""


class WaitsAtItsEnd:
    """An object whose finalizer waits for a transform."""

    def __del__(self):
        future = buffer.wait_for_transform_async("map", "never", Time(seconds=3), timeout=0.01)
        future.add_done_callback(lambda _: None)
        future.cancel()
        buffer.can_transform("map", "never", Time(seconds=3), 0.0001)


def wait():
    for _ in range(10):
        buffer.wait_for_transform_async("map", "never", Time(seconds=3), timeout=100.0)
    future = buffer.wait_for_transform_async("map", "never", Time(seconds=3), timeout=0.001)
    future.add_done_callback(lambda future: future.exception())
    buffer.can_transform("map", "never", Time(seconds=3), 0.0005)


def insert():
    future = buffer.wait_for_transform_async("map", "robot", Time(seconds=random.randrange(1, 1000)))
    future.add_done_callback(lambda _: None)
    buffer.set_transform(transform("map", "robot", random.randrange(1, 1000)), "me")


def filter_messages():
    point = PointStamped()
    point.header.frame_id, point.header.stamp.sec = "robot", random.randrange(1, 1000)
    message_filter.add(point)
    stream = message_filter.__aiter__()
    buffer.set_transform(transform("map", "robot", random.randrange(1, 1000)), "me")
    del stream


def listen():
    listener = TransformListener(Buffer(), node)
    listener.unregister()


def ask_nobody():
    with suppress(TransformException):
        client.lookup_transform("map", "robot", Time(), timeout=0.001)


def make_garbage():
    cycle = [WaitsAtItsEnd()]
    cycle.append(cycle)
    gc.collect(0)


def elsewhere(call, what):
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(DEADLINE_S)
    if thread.is_alive():
        problems.append(f"{what} hangs")
        faulthandler.dump_traceback()


def check():
    """Whether everything works, seen from another thread."""
    done = threading.Event()

    def look():
        future = buffer.wait_for_transform_async("map", "never", Time(seconds=3), timeout=0.01)
        future.add_done_callback(lambda future: (future.exception(), done.set()))
        if not done.wait(DEADLINE_S / 2):
            problems.append("a timeout has no end")

    def lock():
        with LOCK:
            pass

    def pass_one():
        passed = threading.Event()
        with MessageFilter(None, Buffer(), "robot", 0, node=spun) as other:
            other.registerCallback(lambda _: passed.set())
            point = PointStamped()
            point.header.frame_id = "robot"
            other.add(point)
            if not passed.wait(DEADLINE_S / 2):
                problems.append("a filter passes nothing")

    elsewhere(lock, "the lock")
    elsewhere(look, "a future")
    elsewhere(lambda: message_filter.statistics(), "a filter's counts")
    elsewhere(lambda: message_filter.clear(), "a filter")
    elsewhere(pass_one, "a new filter")
    elsewhere(ask_nobody, "the client")
    buffer._self_check()


seconds, how = float(sys.argv[1]), sys.argv[2:]
if "switch" in how:
    sys.setswitchinterval(1e-6)
if "collector" in how:
    gc.set_threshold(1)
rclpy.init(args=[])
# Spun in another thread, which no signal interrupts.
spun = rclpy.create_node("spun", enable_rosout=False, start_parameter_services=False)
threading.Thread(target=rclpy.spin, args=(spun,), daemon=True).start()
node = rclpy.create_node("interrupted", enable_rosout=False, start_parameter_services=False)
buffer, problems, armed, hits, rounds = Buffer(cache_time=2000.0), [], False, 0, 0
client = BufferClient(spun, "no_server")
message_filter = MessageFilter(None, buffer, "map", 100, node=spun)
message_filter.registerCallback(lambda _: None)


def interrupt(*_):
    global armed
    if armed:
        armed = False
        raise Interrupt


signal.signal(signal.SIGINT, interrupt)
works = [wait, insert, filter_messages, ask_nobody, *([make_garbage] if "finalizer" in how else [listen])]
end = time.monotonic() + seconds
while time.monotonic() < end and not problems:
    work = random.choice(works)
    timer = random.uniform(1e-6, 5e-3 if work is listen else 5e-4)
    signal.signal(signal.SIGALRM, interrupt)
    rounds += 1
    try:
        signal.setitimer(signal.ITIMER_REAL, timer)
        armed = True
        work()
        armed = False
    except Interrupt:
        hits += 1
    except Exception as error:
        # Python replaces it in Thread.start(), and a listener that is not whole cannot be ended like one.
        if not isinstance(error.__context__, Interrupt):
            raise
        hits += 1
    armed = False
    signal.setitimer(signal.ITIMER_REAL, 0)
    if rounds % 500 == 0:
        check()
check()
counts = message_filter.statistics()
print(problems, f"{hits} interrupts in {rounds} rounds", counts, flush=True)
signal.signal(signal.SIGALRM, signal.SIG_IGN)
message_filter.close()
sys.exit(bool(problems))
