"""Processes that obey orders: lines of JSON on standard input, a line of JSON as each answer."""

import json
import os
import queue
import subprocess
import sys
import threading
import traceback
from typing import Any


class Disobeyed(Exception):
    """A process failed at an order, ended, or did not answer in time."""


def obey(servant: Any) -> None:
    """Call `do_<order>` of the servant for each line of standard input; print what it returns."""
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    busy = threading.Event()
    threading.Thread(target=_listen, args=(lines, busy), daemon=True).start()
    while line := lines.get():
        order = json.loads(line)
        try:
            answer = {"answer": getattr(servant, "do_" + order.pop("do"))(**order)}
        except Exception:
            answer = {"failed": traceback.format_exc()}
        busy.clear()
        print(json.dumps(answer), flush=True)


def _listen(lines, busy):
    for line in sys.stdin:
        busy.set()
        lines.put(line)
    if busy.is_set():
        os._exit(1)  # whoever waits for the answer is dead
    lines.put("")


class Servant:
    """A process that obeys; it ends with a `with` statement, or with this process, whose pipe it reads."""

    def __init__(self, name: str, command: list[str], environment: dict[str, str]) -> None:
        self.name = name
        self.process = subprocess.Popen(
            command,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is only for this process; the others end with their input
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)
        self._lines.put("")

    def order(self, what: str, limit_s: float = 60.0, **how: Any) -> Any:
        """Give an order, and wait for its answer, so many seconds at most."""
        self.begin(what, **how)
        return self.answer(limit_s)

    def begin(self, what: str, **how: Any) -> None:
        """Give an order; `answer` waits for what it returns."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps({"do": what, **how}) + "\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            raise Disobeyed(f"{self.name} ended with status {self.process.wait()} before {what}") from None

    def answer(self, limit_s: float = 60.0) -> Any:
        try:
            line = self._lines.get(timeout=limit_s)
        except queue.Empty:
            raise Disobeyed(f"{self.name} did not answer within {limit_s:g} s") from None
        if not line:
            raise Disobeyed(f"{self.name} ended with status {self.process.wait()}")
        answer = json.loads(line)
        if "failed" in answer:
            raise Disobeyed(f"{self.name}: {answer['failed']}")
        return answer["answer"]

    def __enter__(self) -> "Servant":
        return self

    def __exit__(self, *error: object) -> None:
        assert self.process.stdin is not None
        try:
            self.process.stdin.close()
            self.process.wait(20.0)
        except (BrokenPipeError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
