"""Waits for a transform that is never inserted, until it is interrupted."""

import threading

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_ros import Buffer


def main():
    rclpy.init()
    buffer = Buffer()

    def report():
        while not buffer.statistics()["waiters"]:
            threading.Event().wait(0.001)
        print("waiting", flush=True)

    threading.Thread(target=report, daemon=True).start()
    buffer.lookup_transform("map", "robot", Time(), Duration(seconds=60))


if __name__ == "__main__":
    main()
