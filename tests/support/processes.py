# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start the tests' other processes, and end them."""

import atexit
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress
from functools import cache

from paths import PROGRAMS, SUPPORT
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
    with process:
        try:
            yield process
        finally:
            process.kill()


def end(process):
    """Ask a publisher to end: killed, it might hold a lock in the shared memory of those it sends to."""
    process.terminate()
    try:
        process.wait(DEADLINE_S)
    finally:
        process.kill()
        process.wait()


class Forked:
    """
    A process of a Python program that `forking_server.py` starts; with a few methods of `subprocess.Popen`.

    :param modules: of those that it imports later, which also can be there when it starts.
    :param environment: of the program; None: that of the first process with these modules.
    :param stderr: a descriptor.
    """

    def __init__(self, program, *arguments, modules=(), python=sys.executable, environment=None, stderr=2):
        variables = None if environment is None else tuple(environment.items())
        server = _forking_server(str(program), tuple(modules), str(python), variables)
        read_input, write_input = os.pipe()
        read_output, write_output = os.pipe()
        given = read_input, write_output, stderr
        socket.send_fds(server, [json.dumps(arguments).encode()], given)
        # A descriptor, which nobody else gets when the process has ended, unlike its id.
        self._process = os.pidfd_open(int(server.recv(100)))
        os.close(read_input)
        os.close(write_output)
        self.stdin, self.stdout = open(write_input, "w"), open(read_output)

    def send_signal(self, number):
        signal.pidfd_send_signal(self._process, number)

    def end(self, timeout=0.0):
        """Close its standard input, and kill it if it has not ended after this time."""
        if self.stdin.closed:
            return
        with suppress(BrokenPipeError):
            self.stdin.close()
        if not select.select([self._process], [], [], timeout)[0]:
            self.send_signal(signal.SIGKILL)
            select.select([self._process], [], [])
        self.stdout.close()
        os.close(self._process)


@cache
def _forking_server(program, modules, python, variables):
    """The connection to a server, which ends with this process."""
    ours, theirs = socket.socketpair()
    command = [python, str(SUPPORT / "forking_server.py"), str(theirs.fileno()), program, *modules]
    environment = None if variables is None else dict(variables)
    server = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()])
    theirs.close()
    atexit.register(lambda: (ours.close(), server.wait()))
    return ours


class Peer:
    """A node in another process, `programs/publishes_on_order.py`: obeys commands, and says that it did."""

    def __init__(self, *ros_arguments):
        arguments = ["--ros-args", *ros_arguments] if ros_arguments else []
        program = PROGRAMS / "publishes_on_order.py"
        self._process = Forked(program, *arguments)
        self._lock = threading.Lock()  # a callback may send while the main thread waits for an answer

    def do(self, what, **how):
        with self._lock:
            self._process.stdin.write(json.dumps({"do": what, **how}) + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
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
        self._process.end(DEADLINE_S)
