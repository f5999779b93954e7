"""Run the sending host: it broadcasts robots at a rate, and where their sensors are mounted."""

import sys
import threading
import time
from typing import Any

import rclpy

from reliability.motion import ROBOTS, Motion, S, mounted
from reliability.orders import obey
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster


class Sender:
    """Sends message n at the time epoch + n periods, with that as its stamp."""

    def __init__(self, node: Any, epoch_ns: int, rate: int, depth: int) -> None:
        self._motion, self._period_ns = Motion(epoch_ns), S // rate
        self._dynamic = TransformBroadcaster(node, depth)
        self._static = StaticTransformBroadcaster(node)
        self._sent = range(0)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._send)

    def do_begin(self) -> None:
        self._thread.start()

    def _send(self):
        epoch, period = self._motion.epoch_ns, self._period_ns
        first = (time.time_ns() - epoch) // period + 1
        number = first
        while not self._end.is_set():
            stamp = epoch + number * period
            while (early := stamp - time.time_ns()) > 0:
                self._end.wait(early / S)
                if self._end.is_set():
                    return
            self._dynamic.sendTransform([self._motion.robot(index, stamp) for index in range(ROBOTS)])
            number += 1
            self._sent = range(first, number)

    def do_mount(self, sensors: list[int]) -> None:
        """Publish where these sensors are, in one message."""
        self._static.sendTransform([mounted(sensor) for sensor in sensors])

    def do_end(self) -> list[int]:
        """End sending; the stamps of all messages."""
        self._end.set()
        self._thread.join()
        return [self._motion.epoch_ns + number * self._period_ns for number in self._sent]


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("sender")
    sender = Sender(node, *map(int, sys.argv[1:]))
    try:
        obey(sender)
    finally:
        if sender._thread.is_alive():
            sender.do_end()
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
