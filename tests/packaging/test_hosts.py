"""Two hosts in network namespaces, whose link is cut or loses packets; `reliability.hosts` judges."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import DEADLINE_S, until

from reliability.hosts import UNAVAILABLE

pytestmark = [pytest.mark.ours, pytest.mark.long("makes two hosts and cuts their link")]

COMMAND = [sys.executable, "-m", "reliability.hosts", "--quick"]


def descendants(pid):
    """The ids of all processes below one."""
    children = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = status.read_text().rpartition(")")[2].split()[1]
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has just ended
        if int(parent) == pid:
            children.append(int(status.parent.name))
    return children + [below for child in children for below in descendants(child)]


def runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def skip_if_unavailable(process, out):
    if process.returncode == UNAVAILABLE:
        pytest.skip(out.strip())


@pytest.mark.timeout(300)
def test_hosts_whose_link_is_cut_or_loses_packets_get_right_answers_or_honest_errors():
    done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=280)
    skip_if_unavailable(done, done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["ok"] * 2


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_nothing_is_left_of_hosts_whose_run_is_ended(ending):
    process = subprocess.Popen(COMMAND, stdout=subprocess.PIPE, text=True)
    try:
        # Two hosts, a sender and a receiver.
        until(lambda: process.poll() is not None or len(descendants(process.pid)) >= 4)
        below = descendants(process.pid)
        if process.poll() is None:
            os.kill(process.pid, ending)
        out, _ = process.communicate(timeout=2 * DEADLINE_S)
        skip_if_unavailable(process, out)
    finally:
        process.kill()
    assert below
    until(lambda: not any(map(runs, below)))
