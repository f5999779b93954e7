"""Run each library in a process of its own, which takes orders as lines of JSON."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

CONTESTANTS = Path(__file__).resolve().parent / "contestants"
ANSWER_S = 300.0  # the longest order is loading the largest tree
COMMAND_S = 300.0
END_S = 10.0
# What clock_getcpuclockid makes of the id of a process.
CLOCK_SHIFT, CLOCK_OF_SCHEDULER = 3, 2
SHARED_BUFFER = "TF2_SHARED_BUFFER"  # the environment's variable


class Failure(Exception):
    """Something is not available, or a process did not carry out an order."""


class Refusal(Failure):
    """A process answers that it could not carry out an order; it takes further ones."""


def clean_environment(extra: Mapping[str, str] = {}) -> dict[str, str]:
    """This environment without what a Python with ROS wheels leaves to its children, plus `extra`."""
    environment = dict(os.environ)
    if environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None):
        environment.pop("LD_LIBRARY_PATH", None)
    # It would override the range of discovery.
    environment.pop("ROS_LOCALHOST_ONLY", None)
    # With it, listeners would not listen.
    environment.pop(SHARED_BUFFER, None)
    # As in the published figures of upstream; and it makes no library slower.
    environment["PYTHONOPTIMIZE"] = "1"
    # NumPy's helper threads spin for a while, beside whatever is measured.
    environment["OPENBLAS_NUM_THREADS"] = "1"
    environment.update(extra)
    return environment


def run_command(
    *command: str, cwd: Path | None = None, seconds: float = COMMAND_S, environment: Mapping[str, str] = {}
) -> str:
    """What a command prints; Failure where it fails or takes longer than `seconds`."""
    try:
        return subprocess.run(
            command,
            cwd=cwd,
            env=clean_environment(environment),
            check=True,
            capture_output=True,
            text=True,
            timeout=seconds,
        ).stdout
    except OSError as error:
        raise Failure(str(error)) from None
    except subprocess.TimeoutExpired:
        raise Failure(f"{command[0]} took longer than {seconds:.0f} s") from None
    except subprocess.CalledProcessError as error:
        raise Failure(f"{command[0]} ended with {error.returncode}: {last_line(error.stderr)}") from None


def last_line(text: str) -> str:
    """The last line of an error message, without valgrind's own (==) and pip's advice ([notice])."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith(("==", "[notice]"))]
    return lines[-1] if lines else "no message"


@dataclass
class Library:
    """A library to measure: how its process is started, and what it is called."""

    key: str
    title: str
    command: Sequence[str]
    ways: tuple[str, ...]  # of a single lookup
    environment: dict[str, str] = field(default_factory=dict)
    note: str = ""
    about: dict[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        return f"{self.title} {self.about.get('version', '')}".strip()


class Process:
    """A running library."""

    def __init__(self, library: Library) -> None:
        self.library = library
        self._log = tempfile.TemporaryFile(mode="w+")
        self._process = subprocess.Popen(
            library.command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env=clean_environment(library.environment),
        )

    def ask(self, *words: object, seconds: float = ANSWER_S) -> dict[str, Any]:
        """Give an order, wait for its answer. Failure where it fails, ends or takes longer than `seconds`."""
        assert self._process.stdin is not None and self._process.stdout is not None
        deadline = time.monotonic() + seconds
        timer = threading.Timer(seconds, self._process.kill)
        timer.start()
        try:
            self._process.stdin.write(json.dumps(words, default=os.fspath) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        finally:
            timer.cancel()
        if not line:
            code = self._process.wait()
            if time.monotonic() >= deadline:
                raise Failure(f"no answer to {words[0]} within {seconds:.0f} s")
            self._log.seek(0)
            raise Failure(f"it ended with {code}: {last_line(self._log.read())}")
        answer = json.loads(line)
        if "error" in answer:
            raise Refusal(answer["error"])
        return answer

    def cpu_ns(self) -> int:
        """CPU of the process since its start, in all its threads; the process does nothing for the answer."""
        return time.clock_gettime_ns(~self._process.pid << CLOCK_SHIFT | CLOCK_OF_SCHEDULER)

    def end(self) -> None:
        """Let it end by itself, if it does so soon; may be called again."""
        if self._log.closed:
            return
        try:
            self._process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
        self._log.close()
