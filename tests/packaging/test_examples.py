# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The examples: each runs, and ends cleanly."""

import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from excused_faults import tried
from paths import ROOT
from processes import killed, run
from waiting import DEADLINE_S

EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))

# What each of the longer ones prints before it waits for something: interrupted then, it is not at its end.
WAITS_AFTER = {
    "buffer_server": "the client waits",
    "demo": "Where the camera is in the map",
    "message_filter": "scan of 1.00 s",
    "web_server": "/health  200",
}
# What some need besides ROS.
NEEDS = {"web_server": "aiohttp"}
INTERRUPTED = 128 + signal.SIGINT  # the exit status, as shells count it


def each(names):
    """The values of a parameter: names of examples."""
    for name in names:
        yield pytest.param(name, marks=[pytest.mark.long(f"needs {NEEDS[name]}")] if name in NEEDS else [])


def example_of(name):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    return ROOT / "examples" / f"{name}.py"


@pytest.mark.parametrize("name", [*each(EXAMPLES)])
def test_an_example_runs_and_ends_by_itself(name):
    example = example_of(name)
    done = tried(lambda: run(sys.executable, example, timeout=3 * DEADLINE_S))
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def test_a_loop_closure_corrects_scans_of_the_past_and_those_that_wait_for_it():
    done = tried(lambda: run(sys.executable, example_of("correct_past"), timeout=3 * DEADLINE_S))
    assert done.returncode == 0, done.stderr
    lines = re.findall(r"x = ([\d.]+) m when it passed the filter, and is at x = ([\d.]+) m now", done.stdout)
    passed, now = np.array(lines, float).T
    assert now == pytest.approx(np.arange(0.6, 3.0, 0.25))
    # The odometry is 10 % too far. The last keyframe before that of the loop closure is at 2.5 m.
    waited = now > 2.5
    assert passed[~waited] == pytest.approx(1.1 * now[~waited])
    assert passed[waited] == pytest.approx(now[waited])


@pytest.mark.parametrize("name", [*each(WAITS_AFTER)])
def test_an_example_ends_cleanly_on_ctrl_c(name, tmp_path):
    example = example_of(name)
    done = tried(lambda: interrupted(example, WAITS_AFTER[name], tmp_path / "errors"))
    assert done.returncode == INTERRUPTED, done.stderr
    assert "Traceback" not in done.stderr


def interrupted(example, line, errors):
    """An example that gets a Ctrl-C after it has printed a line, ended; its standard error goes to a file."""
    pipes = {"text": True, "stdout": subprocess.PIPE, "env": {**os.environ, "PYTHONUNBUFFERED": "1"}}
    with (
        errors.open("w") as stderr,
        killed(
            subprocess.Popen([sys.executable, example], stderr=stderr, start_new_session=True, **pipes)
        ) as process,
    ):
        assert any(line in printed for printed in process.stdout)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the whole group
        process.communicate(timeout=DEADLINE_S)
    return subprocess.CompletedProcess(process.args, process.returncode, stderr=errors.read_text())
