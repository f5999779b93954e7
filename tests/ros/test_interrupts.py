# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A signal handler that raises at a random moment, as Ctrl-C does, leaves nothing that hangs."""

import signal
import threading

import pytest
from excused_faults import WITHOUT_LOCKS_LEFT
from paths import PROGRAMS
from processes import output_of
from random_runs import times
from waiting import until

from tf2_ros._process import threads


class Interrupt(BaseException):
    """What the handler raises."""


@pytest.mark.repeated
@WITHOUT_LOCKS_LEFT
@pytest.mark.parametrize("how", [[], ["switch"], ["collector", "finalizer"]], ids=lambda how: "-".join(how))
def test_chance_finds_nothing_that_hangs(how):
    """By hand for minutes: ``cd tests/support; PYTHONPATH=. python programs/interrupts_at_random.py 60``."""
    assert "[]" in output_of(PROGRAMS / "interrupts_at_random.py", times(1, 3), *how)


def test_a_thread_whose_start_is_interrupted_ends(tf2_ros, node, buffer, monkeypatch):
    """Most of it is a wait, until the new thread runs."""
    start, main, interrupted = threading.Thread.start, threading.main_thread().ident, threading.Event()

    def interrupt(*_):
        if not interrupted.is_set():
            interrupted.set()
            raise Interrupt

    def interrupted_start(thread):
        if thread.name == "tf2_ros listener":
            signal.pthread_kill(main, signal.SIGUSR1)
            # A signal that comes just before the main thread waits does not interrupt its wait.
            while not interrupted.wait(0.1):
                signal.pthread_kill(main, signal.SIGUSR1)
        start(thread)

    before = signal.signal(signal.SIGUSR1, interrupt)
    monkeypatch.setattr(threading.Thread, "start", interrupted_start)
    with pytest.raises(Interrupt):
        tf2_ros.TransformListener(buffer, node, spin_thread=True)
    until(lambda: not threads._beginning)
    monkeypatch.undo()
    signal.signal(signal.SIGUSR1, before)
    until(lambda: "tf2_ros listener" not in [thread.name for thread in threading.enumerate()])
