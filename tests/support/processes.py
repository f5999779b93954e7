# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start the tests' other processes, and end them."""

import json
import subprocess
import sys
import threading
from contextlib import contextmanager

from paths import PROGRAMS
from waiting import DEADLINE_S


def run(*command, **popen):
    """What a command ended with; the tests' own time limit ends one that hangs."""
    return subprocess.run([*map(str, command)], text=True, capture_output=True, **popen)


def output_of(*arguments, **popen):
    """Run Python with these arguments until it ends, without an error; its standard output."""
    done = run(sys.executable, *arguments, **popen)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def start(program, *arguments, **popen):
    """Start one of the tests' programs: its name, or its path."""
    return subprocess.Popen([sys.executable, str(PROGRAMS / program), *arguments], text=True, **popen)


@contextmanager
def killed(process):
    """A process that a `with` statement kills in the end."""
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def end(process):
    """Ask a publisher to end: killed, it might hold a lock in the shared memory of those it sends to."""
    process.terminate()
    try:
        process.wait(DEADLINE_S)
    finally:
        process.kill()
        process.wait()


class Peer:
    """A node in another process, `programs/publishes_on_order.py`: obeys commands, and says that it did."""

    def __init__(self, *ros_arguments):
        arguments = ["--ros-args", *ros_arguments] if ros_arguments else []
        self.process = start(
            "publishes_on_order.py", *arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._lock = threading.Lock()  # a callback may send while the main thread waits for an answer

    def do(self, what, **how):
        with self._lock:
            self.process.stdin.write(json.dumps({"do": what, **how}) + "\n")
            self.process.stdin.flush()
            answer = self.process.stdout.readline()
        assert answer == "ok\n", f"the peer answered {answer!r}"

    def send(self, *transforms, static=False):
        """Publish transforms, each (parent, child, stamp in ns, x in m), once there is a subscriber."""
        self.do("send", transforms=transforms, static=static)

    def send_without_subscriber(self, *transforms, static=False):
        """The same, whether there is a subscriber or not."""
        self.do("send", transforms=transforms, static=static, subscribed=False)

    def send_bytes(self, data, topic="/tf"):
        self.do("bytes", topic=topic, hex=data.hex())

    def send_text(self, topic):
        """Publish a message of another type than TFMessage, whether there is a subscriber or not."""
        self.do("text", topic=topic)

    def matched(self, count):
        """Wait until /tf has so many subscribers."""
        self.do("matched", count=count)

    def set_clock(self, seconds, *, subscribed=True):
        """Publish a time, the first once there is a subscriber."""
        self.do("clock", seconds=seconds, subscribed=subscribed)

    def end(self):
        if not self.process.stdin.closed:
            self.process.stdin.close()
        try:
            self.process.wait(timeout=DEADLINE_S)
        finally:
            self.process.kill()
            self.process.stdout.close()
