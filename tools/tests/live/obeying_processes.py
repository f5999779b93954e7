# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Processes that run what a test orders, such as a robot and a laptop without ROS 2."""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

from waiting import DEADLINE_S, until


class OrderError(Exception):
    """What an order raised, as its class and its text."""


class Obeying:
    """A process that runs Python on order."""

    def __init__(self, *arguments, python=sys.executable, environment=os.environ):
        pipe = subprocess.PIPE
        command = [str(python), str(Path(__file__).with_name("evaluates_stdin.py")), *arguments]
        self.process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment
        )
        self._errors = []
        self._reading = threading.Thread(target=lambda: self._errors.extend(self.process.stderr))
        self._reading.start()

    def do(self, code):
        """Run statements, or evaluate an expression, and return its value."""
        self.begin(code)
        return self.finish()

    def begin(self, code):
        """Run it, and do not wait for it."""
        self.process.stdin.write(json.dumps(code) + "\n")
        self.process.stdin.flush()

    def finish(self):
        """What came out of what was begun."""
        line = self.process.stdout.readline()
        assert line, "it has ended: " + "".join(self._errors)
        answer = json.loads(line)
        if "error" in answer:
            raise OrderError(answer["error"]) from Exception(answer["traceback"])
        return answer["value"]

    def until(self, code):
        """Evaluate an expression until its value is true."""
        return until(lambda: self.do(code))

    def errors(self):
        """What it has written to its standard error."""
        return "".join(self._errors)

    def kill(self):
        self.process.kill()
        self._close()

    def end(self):
        """End it as a program ends."""
        if not self.process.stdin.closed:
            self.process.stdin.close()
        try:
            self.process.wait(DEADLINE_S)
        finally:
            self.kill()

    def _close(self):
        self.process.wait()
        self._reading.join()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()
