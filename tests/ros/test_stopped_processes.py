"""SIGSTOP and SIGCONT while a process waits: nothing is lost, deadlines hold, and no lock stays taken."""

import os
import signal
import subprocess
from contextlib import contextmanager

import pytest
from processes import DEADLINE_S, PROMPT_S, start, until

pytestmark = pytest.mark.ours

STOPPED_S = 0.7


def state_of(process):
    with open(f"/proc/{process.pid}/stat") as stat:
        return stat.read().rpartition(")")[2].split()[0]


@contextmanager
def stopped(process):
    """The process stands still during a `with` statement."""
    os.kill(process.pid, signal.SIGSTOP)
    try:
        until(lambda: state_of(process) == "T")
        yield
    finally:
        os.kill(process.pid, signal.SIGCONT)


@pytest.fixture
def stops():
    """Starts `programs/stops.py`, which says a line and waits in one way."""
    processes = []

    def begin(way, *arguments):
        process = start("stops.py", way, *map(str, arguments), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        processes.append(process)
        assert process.stdout.readline() == "waiting\n"
        return process

    yield begin
    for process in processes:
        process.kill()
        process.communicate()


def rest_of(process):
    out, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0
    return out.split()


@pytest.mark.parametrize("way", ["blocking", "awaiting"])
def test_a_deadline_that_passed_meanwhile_ends_the_wait_at_once(stops, way):
    process = stops(way, STOPPED_S / 2)
    with stopped(process):
        # Longer than the timeout: nothing but time can pass here.
        pytest.raises(subprocess.TimeoutExpired, process.wait, STOPPED_S)
    outcome, waited_s, after_s = rest_of(process)
    assert outcome in ("LookupException", "TimeoutException")
    assert float(waited_s) >= STOPPED_S / 2
    assert float(after_s) < PROMPT_S


def test_messages_that_arrive_meanwhile_are_received(stops, peer):
    """For a reader that stands still, the middleware keeps the last hundred of /tf, and all of /tf_static."""
    sender = peer()
    process = stops("receiving", 30)
    sender.matched(1)
    sender.send(("map", "base", 10**9, 1.0))
    for _ in range(3):
        with stopped(process):
            sender.send(*(("map", f"f{i}", 10**9, 1.0) for i in range(10)))
            sender.send(("base", "camera", 0, 1.0), static=True)
    sender.send(("map", "base", 2 * 10**9, 1.0))
    assert rest_of(process)[0] == "13"
