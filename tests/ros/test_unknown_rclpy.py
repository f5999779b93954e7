# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An rclpy that nobody knows yet: everything works, if need be through executors; texts give its version."""

import asyncio
import os
import re
import shutil
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from paths import PROGRAMS
from processes import run

from tf2_py._internal import assumptions
from tf2_ros import _rclpy
from tf2_ros_cython import _ros_in_use

TOPICS = "without an executor: /tf, /tf_static"
NOTHING = "without an executor: nothing"
THE_REST = ["filter", "on_change", "future", "await", "server and client", "threads of listeners"]

OF_ASYNC_NODES = {_rclpy.TASK_GROUP, _rclpy.SUBSCRIPTIONS_IN_LOOP}
REPORTED = {row for row in vars(_rclpy).values() if isinstance(row, assumptions.Assumption)} - OF_ASYNC_NODES
NAMES = {"Time._time_handle", "Duration._duration_handle", *(row.used for row in REPORTED)}
# Of those that nothing asks for where rcl has all functions, or where it lacks some.
NOT_ASKED = {
    "": {_rclpy.TASK_EXECUTOR.used, _rclpy.EVENT_ARGUMENTS.used},
    "functions": {_rclpy.TASK_LOCK.used, _rclpy.TASKS_LOCK.used, _rclpy.READY_TO_TAKE.used},
}
ONLY_LONG = pytest.mark.long("finds the same rows")


@pytest.mark.parametrize("functions", ["", "functions"])
@pytest.mark.parametrize(
    "way",
    ["", "renamed", pytest.param("another type", marks=ONLY_LONG), pytest.param("raising", marks=ONLY_LONG)],
)
def test_what_it_lacks_is_done_without_and_logged_once(functions, way):
    done = run(sys.executable, PROGRAMS / "uses_unknown_rclpy.py", functions, way)
    assert done.stdout.splitlines() == [NOTHING if functions else TOPICS, *THE_REST], done.stderr
    logged = re.findall(r"\]: (.+?): rclpy [\d.]+ differs from the releases that were tested: ", done.stderr)
    assert sorted(logged) == sorted(NAMES - NOT_ASKED[functions] if way else [])


class OwnNode:
    """What a node that runs in a loop must have, without what rclpy does not promise."""

    async def __aenter__(self):
        return self

    def get_fully_qualified_name(self):
        return "/robot"

    def create_subscription(self, *arguments):
        return arguments


@pytest.fixture
def unreported(monkeypatch):
    for row in assumptions.ROWS:
        monkeypatch.setattr(row, "is_reported", False)


def test_a_node_in_a_loop_that_rclpy_changed_is_done_without(unreported):
    async def use():
        assert _rclpy.loop_of(OwnNode()) is asyncio.get_running_loop()
        assert _rclpy.subscribe_in_loop(OwnNode(), int, "/tf", print, 10) == (int, "/tf", print, 10)

    asyncio.run(use())
    assert {row for row in assumptions.ROWS if row.is_reported} == OF_ASYNC_NODES


def test_an_attribute_is_reported_only_if_the_object_is_rclpys(unreported, monkeypatch):
    row = _rclpy.TASK_LOCK
    monkeypatch.setattr(row, "names", ["_renamed"])
    assert row.of(SimpleNamespace(), "other") == "other"
    assert not row.is_reported
    assert row.of(rclpy.task.Task(print), "other") == "other"
    assert row.is_reported


def test_an_error_of_a_signal_handler_inside_is_not_swallowed(unreported):
    signals = [0]

    class Interrupted:
        @property
        def _task_lock(self):
            return 1 / signals.pop() if signals else threading.Lock()

    with pytest.raises(ZeroDivisionError):
        _rclpy.TASK_LOCK.of(Interrupted())
    assert _rclpy.TASK_LOCK.of(Interrupted()) is not None


def test_all_holds_with_this_rclpy(unreported):
    assert assumptions.broken() == []


@pytest.mark.parametrize("row", assumptions.ROWS, ids=lambda row: row.used)
def test_a_row_is_listed_if_its_probe_says_no_or_raises(row, monkeypatch, unreported):
    for probe in (lambda: False, lambda: 1 / 0):
        monkeypatch.setattr(row, "probe", probe)
        assert assumptions.broken() == [f"{row.used}: {row.lost}"]


def test_tf2_which_prints_each_private_name_that_rclpy_has_renamed(tmp_path):
    prefix = tmp_path / "lib" / "python3" / "site-packages"
    copy = shutil.copytree(
        Path(rclpy.__file__).parent, prefix / "rclpy", ignore=shutil.ignore_patterns("__pycache__")
    )
    used = {name for row in assumptions.ROWS for name in re.findall(r"\b_\w+", row.used)}
    renamed = set()
    for path in copy.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        changed = re.sub(rf"\b({'|'.join(used)})\b", r"\1_renamed", text)
        path.write_text(changed, encoding="utf-8")
        renamed.update(re.findall(r"\b(_\w+)_renamed\b", changed))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(prefix), os.getenv("PYTHONPATH", "")])}
    done = run(sys.executable, "-m", "tf2_ros_cython", env=environment)
    listed = re.findall("^    differs from the releases that were tested: (.*?): ", done.stdout, re.MULTILINE)
    assert renamed >= {"_is_shutdown", "_sigint_gc", "_tasks_lock", "_task_lock", "_executor", "_time_handle"}
    others = {"_loop", "_validate_qos_or_depth_parameter"}  # of asyncio, and of Node
    assert renamed - others <= {*re.findall(r"\b_\w+", " ".join(listed))}, done.stdout
    assert done.stderr == ""  # what is printed is not logged


def test_a_release_is_known_by_its_name_or_by_its_version():
    assert _ros_in_use.describe("10.0.10") == "Lyrical (rclpy 10.0.10)"
    assert _ros_in_use.describe("99.0.1") == "of rclpy 99.0.1"
