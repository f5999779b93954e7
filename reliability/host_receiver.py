"""Run the receiving host: a buffer and a listener, constant lookups, and what was wrong with them."""

import random
import re
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration

from reliability.motion import ROBOTS, WORLD, Motion, S, robot_frame, sensor_frame
from reliability.orders import obey
from tf2_ros import (
    Buffer,
    BufferClient,
    ExtrapolationException,
    LookupException,
    TimeoutException,
    TransformException,
    TransformListener,
)

CACHE_S = 300.0
UNKNOWN = "nobody"
PAUSE_S = 0.005
IMPOSSIBLE = 0.2  # the share of goals that nobody can answer
PADDING_S = LATE_S = 1.0  # what a client adds to the timeout of a goal; what the machine may add
FUTURE = re.compile(
    r"extrapolation into the future\.  Requested time (?P<requested>\d+\.\d{9}) "
    r"but the latest data is at time (?P<latest>\d+\.\d{9}), "
    r"when looking up transform from frame \[(?P<source>\w+)\] to frame \[(?P<target>\w+)\]; "
    r"(?P<gap>\d+\.\d{9}) s are missing after the newest sample of (?P<robot>\w+) in (?P<parent>\w+)"
    r"(?:; nothing has been received on /tf for \d+ s)?$"
)


class Receiver:
    def __init__(self, node: Any, epoch_ns: int, depth: int) -> None:
        self._node, self._motion = node, Motion(epoch_ns)
        self._buffer = Buffer(Duration(seconds=CACHE_S), node)
        self._listener = TransformListener(self._buffer, node, spin_thread=True, qos=depth)
        self._sensors: list[int] = []
        self._counts: Counter[str] = Counter()
        self._counting = threading.Lock()
        self._wrong: list[str] = []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._ask)
        self._pending: list[tuple[str, threading.Thread, dict[str, Any]]] = []

    # Reception.

    def do_complete(self, sensors: list[int], within: float) -> float:
        """Wait until each of these sensors is found in the world; how many seconds that took."""
        began = time.monotonic()
        missing = sensors
        while missing := [one for one in missing if not self._finds(one)]:
            if time.monotonic() - began > within:
                raise TimeoutError(f"not found after {within} s: {list(map(sensor_frame, missing))}")
            threading.Event().wait(0.01)
        self._sensors = sensors
        return time.monotonic() - began

    def _finds(self, sensor):
        return self._buffer.can_transform(WORLD, sensor_frame(sensor), 0)

    def do_newer(self, than_ns: int, within: float) -> float:
        """Wait until each robot has a sample newer than a time; how many seconds that took."""
        began = time.monotonic()
        while min(self._newest(index) for index in range(ROBOTS)) <= than_ns:
            if time.monotonic() - began > within:
                raise TimeoutError(f"nothing newer than {than_ns} after {within} s")
            threading.Event().wait(0.005)
        return time.monotonic() - began

    def _newest(self, index):
        return self._buffer.get_latest_common_time(WORLD, robot_frame(index)).nanoseconds

    def do_knows(self, sensors: list[int]) -> list[int]:
        """Which of these sensors are known."""
        return [sensor for sensor in sensors if sensor_frame(sensor) in self._buffer]

    def do_stamps(self) -> list[int]:
        """The stamps of which all robots have a sample."""
        held = self._buffer.histories()
        each = [set(held[robot_frame(index)].stamps_ns.tolist()) for index in range(ROBOTS)]
        if any(one != each[0] for one in each):
            self._wrong.append("a message was inserted in part")
        return sorted(each[0])

    # Lookups all the time.

    def do_ask(self) -> None:
        """From now on look up at all kinds of times, until the end."""
        self._thread.start()

    def _ask(self):
        chance = random.Random(1)
        while not self._end.wait(PAUSE_S):
            sensor, now = chance.choice(self._sensors), time.time_ns()
            self._judge("newest", sensor, 0)
            self._judge("now", sensor, now)
            self._judge("past", sensor, now - chance.randrange(60 * S))

    def _judge(self, kind, sensor, stamp_ns):
        try:
            answer = self._buffer.lookup_transform(WORLD, sensor_frame(sensor), stamp_ns)
        except ExtrapolationException:
            self._count(f"{kind} refused")
            if kind == "newest":
                self._wrong.append(f"time 0 of a known sensor {sensor} was refused")
        except TransformException as error:
            self._wrong.append(f"{kind}: {type(error).__name__}: {error}")
        else:
            self._answer(kind, sensor, answer, stamp_ns)

    def _count(self, what):
        with self._counting:
            self._counts[what] += 1

    def _answer(self, kind, sensor, answer, stamp_ns):
        self._count(f"{kind} answered")
        wrong = self._motion.error_of(sensor, answer, stamp_ns or None)
        if wrong is not None:
            self._wrong.append(f"{kind}: {wrong}")

    # While the link is cut.

    def do_silence(self, seconds: float) -> dict[str, Any]:
        """Look up while nothing arrives: the errors must be honest, and time 0 give the last data."""
        newest = [self._newest(index) for index in range(ROBOTS)]
        until = time.monotonic() + seconds
        refused = 0
        while time.monotonic() < until:
            sensor = self._sensors[refused % len(self._sensors)]
            self._check_refusal(sensor, newest[sensor % ROBOTS])
            answer = self._buffer.lookup_transform(WORLD, sensor_frame(sensor), 0)
            self._answer("newest", sensor, answer, newest[sensor % ROBOTS])
            refused += 1
            threading.Event().wait(PAUSE_S)
        if newest != [self._newest(index) for index in range(ROBOTS)]:
            self._wrong.append("something arrived although the link was cut")
        return {"refused": refused, "newest_ns": newest[0]}

    def _check_refusal(self, sensor, newest_ns):
        asked = time.time_ns()
        try:
            self._buffer.lookup_transform(WORLD, sensor_frame(sensor), asked)
        except ExtrapolationException as error:
            text = str(error)
        except TransformException as error:
            self._wrong.append(f"{type(error).__name__}, not ExtrapolationException: {error}")
            return
        else:
            self._wrong.append("answered for a time without data")
            return
        found = FUTURE.search(text)
        said = found and [_as_ns(found[name]) for name in ("requested", "latest", "gap")]
        names = found and [found[name] for name in ("source", "target", "robot", "parent")]
        true_names = [sensor_frame(sensor), WORLD, robot_frame(sensor % ROBOTS), WORLD]
        if said != [asked, newest_ns, asked - newest_ns] or names != true_names:
            self._wrong.append(f"an error that is not true: asked {asked}, newest {newest_ns}: {text}")

    # Waits.

    def do_wait(self, long_s: float, short_s: float) -> None:
        """Begin waits for a time that is not there yet: two that may last, two that must end before."""
        stamp = time.time_ns() + S
        for name, seconds in (("long", long_s), ("short", short_s)):
            self._begin(f"{name} lookup", seconds, stamp, self._wait_blocked)
            self._begin(f"{name} future", seconds, stamp, self._wait_for_future)

    def _begin(self, name, seconds, stamp, how):
        result: dict[str, Any] = {}
        sensor = self._sensors[len(self._pending) % len(self._sensors)]
        arguments = (how, sensor, stamp, seconds, result)
        thread = threading.Thread(target=self._wait, args=arguments)
        self._pending.append((name, thread, result))
        thread.start()

    def _wait(self, how: Callable[..., TransformStamped], sensor, stamp, seconds, result):
        began = time.monotonic()
        try:
            answer = how(sensor, stamp, seconds)
        except (ExtrapolationException, TimeoutException) as error:
            result["ended"] = type(error).__name__
        else:
            result["ended"] = "answered"
            self._answer("waited", sensor, answer, stamp)
        result["after"] = time.monotonic() - began

    def _wait_blocked(self, sensor, stamp, seconds):
        return self._buffer.lookup_transform(WORLD, sensor_frame(sensor), stamp, Duration(seconds=seconds))

    def _wait_for_future(self, sensor, stamp, seconds):
        future = self._buffer.wait_for_transform_async(
            WORLD, sensor_frame(sensor), stamp, timeout=Duration(seconds=seconds)
        )
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        done.wait(seconds + 30.0)
        return future.result() if future.done() else None

    def do_waited(self) -> dict[str, Any]:
        """How each of the waits ended, and after how many seconds."""
        for _, thread, _ in self._pending:
            thread.join(60.0)
        return {name: result for name, _, result in self._pending}

    # The buffer server of the other host.

    def do_client(self, askers: int, seconds: float, timeout_s: float, patience_s: float) -> dict[str, int]:
        """
        Ask the server of the other host, from several threads; what its answers were.

        For so many seconds, or longer, until the first answer: a goal is
        four messages, and each that is lost takes DDS 3 s or more to repeat.
        """
        client = BufferClient(self._node, "tf2_buffer_server", timeout_padding=Duration(seconds=PADDING_S))
        # The first goal waits until the server is found.
        client.lookup_transform(WORLD, WORLD, 0, Duration(seconds=60.0))
        outcomes: Counter[str] = Counter()
        end = time.monotonic() + seconds
        arguments = (client, end, end + patience_s, timeout_s, outcomes)
        threads = [threading.Thread(target=self._send_goals, args=(i, *arguments)) for i in range(askers)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        client.destroy()
        return dict(outcomes)

    def _send_goals(self, seed, client, end, last, timeout_s, outcomes):
        chance = random.Random(seed)
        while (began := time.monotonic()) < end or (not outcomes["answered"] and began < last):
            now, sensor = time.time_ns(), chance.choice(self._sensors)
            frame, limit_s = sensor_frame(sensor), timeout_s
            stamp = now + chance.choice([-now, -S // 2, S // 2])
            if chance.random() < IMPOSSIBLE:
                frame, stamp, limit_s = chance.choice([(UNKNOWN, 0, 1.0), (frame, now + 3600 * S, 1.0)])
            try:
                answer = client.lookup_transform(WORLD, frame, stamp, Duration(seconds=limit_s))
            except (ExtrapolationException, LookupException, TimeoutException) as error:
                outcome = type(error).__name__
            else:
                outcome = "answered"
                if frame == UNKNOWN:
                    self._wrong.append(f"the server knows {UNKNOWN}: {answer}")
                else:
                    self._answer("goal", sensor, answer, stamp)
            took = time.monotonic() - began
            with self._counting:
                outcomes[outcome] += 1
            if took > limit_s + PADDING_S + LATE_S:
                self._wrong.append(f"a goal with a timeout of {limit_s} s took {took:.1f} s")

    def do_end(self) -> dict[str, Any]:
        """End the lookups; what they were, and what was wrong."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join()
        statistics = self._buffer.statistics()
        for reason, count in {**statistics["refused"], "malformed": statistics["malformed_messages"]}.items():
            if count:
                self._wrong.append(f"{count} were refused: {reason}")
        return {"counts": dict(self._counts), "wrong": self._wrong, "waiters": statistics["waiters"]}


def _as_ns(seconds):
    whole, fraction = seconds.split(".")
    return int(whole) * S + int(fraction)


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("receiver")
    receiver = Receiver(node, *map(int, sys.argv[1:]))
    try:
        obey(receiver)
    finally:
        receiver.do_end()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
