"""
A node that is spun, as one of many on a machine. What it has beside, and the name of a shared buffer:

`idle`: nothing.
`listening`: a buffer and a TransformListener.
`attached`: the same; the environment has it attach the shared buffer.
`looking`: the same, and it looks a transform up ten times a second.
`owner`: a buffer that it shares, and a TransformListener.
"""

import contextlib
import os
import sys
import threading
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from ros2_tf2 import DISCOVERY_S
from serving import serve

from tf2_ros import Buffer, TransformListener


class Spinning:
    def __init__(self, what, name):
        rclpy.init()
        self._node = rclpy.create_node(f"bench_{what}_{os.getpid()}")
        self._what = what
        self._buffer = self._listener = None
        if what != "idle":
            self._buffer = Buffer(share=name) if what == "owner" else Buffer()
            self._listener = TransformListener(self._buffer, self._node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()
        self._ended = threading.Event()
        if what == "looking":
            threading.Thread(target=self._look, daemon=True).start()

    def _look(self):
        names = []
        while not self._ended.wait(0.1):
            names = names or self._buffer._getFrameStrings()
            if names:
                self._buffer.can_transform_core(names[0], names[-1], 0)

    def _spin(self):
        with contextlib.suppress(ExternalShutdownException):
            rclpy.spin(self._node)

    def order_ready(self, frames):
        """Wait until it has so many frames; whether it takes part as it is meant to."""
        deadline = time.monotonic() + DISCOVERY_S
        while self._buffer is not None and len(self._buffer._getFrameStrings()) < frames:
            if time.monotonic() > deadline:
                return {"error": f"only {len(self._buffer._getFrameStrings())} frames arrived"}
            threading.Event().wait(0.05)
        sharing = None if self._buffer is None else self._buffer._tf2_sharing
        if (sharing is not None and sharing.is_attached) != (self._what in ("attached", "looking")):
            return {"error": f"a node that is meant to be {self._what} is not"}
        return {}

    def end(self):
        """Leave the network."""
        self._ended.set()
        rclpy.shutdown()
        self._thread.join()


if __name__ == "__main__":
    spinning = Spinning(*sys.argv[1:])
    serve(spinning, spinning.end)
