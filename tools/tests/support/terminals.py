# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A terminal for tests: a program in it, and what its screen shows."""

import os
import signal
import sys
import time

import pexpect
import pyte
from waiting import DEADLINE_S


class Terminal:
    """Runs one of the project's programs in a terminal of this size; for a `with` statement."""

    def __init__(self, columns, rows, name, *arguments, **environment):
        self._screen = pyte.Screen(columns, rows)
        self._stream = pyte.Stream(self._screen)
        # readline, which pytest imports, sets the size of another terminal.
        inherited = {name: os.environ[name] for name in os.environ if name not in ("COLUMNS", "LINES")}
        self.process = pexpect.spawn(
            sys.executable,
            ["-m", f"tf2_ros_tools.programs.{name}", *arguments],
            dimensions=(rows, columns),
            encoding="utf-8",
            timeout=DEADLINE_S,
            env={**inherited, "TERM": "xterm-256color", **environment},
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        # By itself, close() would wait for a killed process for a tenth of a second only.
        if self.process.isalive():
            self.process.kill(signal.SIGKILL)
            self.process.wait()
        self.process.close()

    @property
    def lines(self):
        return [line.rstrip() for line in self._screen.display]

    def shows(self, condition):
        """Read what the program writes until the condition holds for the lines of the screen; its value."""
        deadline = time.monotonic() + DEADLINE_S
        while not (value := condition(self.lines)):
            assert time.monotonic() < deadline, "never so; the screen is\n" + "\n".join(self.lines)
            try:
                self._stream.feed(self.process.read_nonblocking(65536, timeout=0.1))
            except pexpect.TIMEOUT:
                continue
        return value

    def press(self, keys):
        self.process.send(keys)

    def ended(self):
        """Read to the end; the exit status."""
        self.process.expect(pexpect.EOF)
        self.process.wait()
        return self.process.exitstatus
