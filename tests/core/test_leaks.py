"""The search for leaks, which is `make leaks`: it finds some, and has a case for each public name."""

import os
import subprocess
import sys
import threading

import pytest
from paths import ROOT
from processes import DEADLINE_S, until
from repetitions import times

from reliability.leaks import leaks, measure

pytestmark = pytest.mark.ours


def test_every_public_name_has_a_case():
    command = [sys.executable, "-m", "reliability.leaks", "--list"]
    ended = subprocess.run(command, cwd=ROOT, text=True, capture_output=True, timeout=3 * DEADLINE_S)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "BufferCore.lookup_transform_core\n" in ended.stdout


def found(action, calls):
    return leaks(measure(action, DEADLINE_S, calls, settle_s=0.2))


def test_what_leaves_nothing_behind_is_no_leak():
    assert found(lambda: [bytes(10_000), threading.Event()], 3000) == []


@pytest.mark.parametrize(
    ("kept", "calls", "what"),
    [
        ("object()", 3000, "objects"),
        ("bytes(1000)", 3000, "heap_bytes"),
        ("b'x' * (1 << 20)", 30, "resident_bytes"),
    ],
)
def test_what_is_kept_is_found(kept, calls, what):
    # In a process of its own: what earlier tests left in this one may be freed in the middle.
    code = f"""
from reliability.leaks import leaks, measure

kept = []
print(*leaks(measure(lambda: kept.append({kept}), {DEADLINE_S}, {calls}, settle_s=0.2)), sep="\\n")
"""
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, text=True, capture_output=True, check=True)
    assert any(line.startswith(what) for line in ended.stdout.splitlines())


def test_threads_and_descriptors_that_stay_are_found():
    ending, threads, files = threading.Event(), [], []

    def action():
        threads.append(threading.Thread(target=ending.wait))
        threads[-1].start()
        files.append(os.open(os.devnull, os.O_RDONLY))

    try:
        texts = found(action, 20)
    finally:
        ending.set()
        for thread in threads:
            thread.join()
        for file in files:
            os.close(file)
    assert [text.split()[0] for text in texts][-2:] == ["threads", "descriptors"]


@pytest.mark.parametrize("seed", range(times(5, 50)))
def test_nothing_is_left_of_what_ended_in_random_order(ros, seed):
    from random_ends import RandomEnds

    ends = RandomEnds(seed)
    ends.play(40)
    # The threads of the last ones may be ending.
    until(lambda: ends.left() == [])
