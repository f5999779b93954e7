# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Processes that run what a test orders, such as a robot and a laptop without ROS 2."""

import json
import os
import threading
from pathlib import Path

from processes import Forked
from waiting import DEADLINE_S, until


class OrderError(Exception):
    """What an order raised, as its class and its text."""


class Obeying:
    """A process that runs Python on order, see `evaluates_stdin.py`; the options are those of `Forked`."""

    def __init__(self, *modules, **options):
        reading, writing = os.pipe()
        program = Path(__file__).with_name("evaluates_stdin.py")
        self.process = Forked(program, modules=modules, stderr=writing, **options)
        os.close(writing)
        self._errors = []
        self._reading = threading.Thread(target=self._read, args=(reading,))
        self._reading.start()

    def _read(self, errors):
        with open(errors) as lines:
            self._errors.extend(lines)

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
        self.end(0.0)

    def end(self, timeout=DEADLINE_S):
        """End it as a program ends."""
        self.process.end(timeout)
        self._reading.join()
