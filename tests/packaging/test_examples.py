"""The examples: each runs, and ends cleanly."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT
from processes import DEADLINE_S, killed, run

pytestmark = pytest.mark.ours

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
    for _ in range(ATTEMPTS):
        done = run(sys.executable, example, timeout=3 * DEADLINE_S)
        if OF_MIDDLEWARE not in done.stderr:
            break
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", [*each(WAITS_AFTER)])
def test_an_example_ends_cleanly_on_ctrl_c(name, tmp_path):
    example = example_of(name)
    for attempt in range(ATTEMPTS):
        status, errors = interrupted(example, WAITS_AFTER[name], tmp_path / f"errors_{attempt}")
        if not raised_in_rclpy(errors):
            break
    assert status == INTERRUPTED, errors
    assert "Traceback" not in errors


# The middleware drops an answer to a client that it does not know within 0.1 s, on a busy machine.
OF_MIDDLEWARE = "failed to send response (timeout)"
ATTEMPTS = 3


def raised_in_rclpy(errors):
    """Whether the code that raised is rclpy's, which leaves a Ctrl-C in some instants with errors of its own.

    Its bindings cannot convert an argument, or a task whose constructor has not come to its end is destroyed.
    """
    places = re.findall(r'^ *File "(.+)", line', errors, re.MULTILINE)
    return bool(places) and "rclpy" in Path(places[-1]).parts


def interrupted(example, line, errors):
    """The exit status and standard error of an example that gets a Ctrl-C after it has printed a line."""
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
    return process.returncode, errors.read_text()
