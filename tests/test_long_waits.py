"""TF2_DEBUG=1: waits that last longer than a second log, once, what they lack."""

import os
import subprocess

import pytest
from processes import DEADLINE_S, start

pytestmark = pytest.mark.ours

LINES = [
    "from frame [lidar] to frame [map] at the latest common time: needs a frame [lidar], which is unknown",
    "from frame [robot] to frame [map] at 5.000000000 s: needs data of frame [robot] at 5.000000000 s",
    "from frame [arm] to frame [map] at the latest common time: needs a frame [arm], which is unknown",
]


def errors(**environment):
    program = start(
        "long_waits.py",
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, **environment},
    )
    _, errors = program.communicate(timeout=DEADLINE_S)
    assert program.returncode == 0
    return errors


def test_each_wait_logs_once_what_it_lacks():
    logged = errors(TF2_DEBUG="1")
    assert [logged.count(line) for line in LINES] == [1, 1, 1]
    assert logged.count("After 1 s, a lookup still waits for the transform") == len(LINES)


def test_without_the_variable_nothing_is_logged():
    assert errors(TF2_DEBUG="0") == "ended\n"
