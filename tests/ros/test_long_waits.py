"""TF2_DEBUG=1: waits that last long log what they lack, after one second and after ten."""

import os
import re
import subprocess

import pytest
from making import transform
from processes import DEADLINE_S, errors_so_far, start, until
from rclpy.time import Time

import tf2_ros
from tf2_ros._wait import blocking as waits

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


def test_each_wait_logs_what_it_lacks():
    logged = errors(TF2_DEBUG="1")
    assert [logged.count(line) for line in LINES] == [1, 1, 1]
    assert logged.count("After 1 s, a lookup still waits for the transform") == len(LINES)


def test_a_wait_that_goes_on_logs_once_more(monkeypatch, capfd):
    monkeypatch.setattr(waits, "DEBUG", True)
    monkeypatch.setattr(waits, "AFTER_S", (0.1, 0.3))
    buffer = tf2_ros.Buffer()
    future = buffer.wait_for_transform_async("map", "lidar", Time())

    def logged():
        return re.findall(r"After (\S+) s, a lookup still waits", errors_so_far())

    until(logged)
    buffer.set_transform_static(transform("map", "odom"), "test")
    assert until(lambda: len(found := logged()) == 2 and found) == ["0.1", "0.3"]
    assert not future.done()


def test_without_the_variable_nothing_is_logged():
    assert errors(TF2_DEBUG="0") == "ended\n"
