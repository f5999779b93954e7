# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The workflows run only what `make` and `.ci/run` also run, so that they need no rehearsal on GitHub."""

import re

import pytest
import yaml
from paths import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z][a-z -]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
TARGETS = {target for line in TARGETS for target in line.split()}
STEPS = set(re.findall(r"^\t\t([a-z-]+)\)", (ROOT / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE))


def steps(workflow):
    """The steps of a workflow, with the values of the matrix of their job."""
    for job in yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"].values():
        matrix = job.get("strategy", {}).get("matrix", {})
        for step in job["steps"]:
            yield step, matrix


def expanded(command, matrix):
    """The commands that a step runs, one for each value of the matrix that it names."""
    if (named := re.fullmatch(r"\$\{\{ matrix\.(\w+) \}\}", command)) is None:
        return [command]
    included = [one[named[1]] for one in matrix.get("include", ()) if named[1] in one]
    return [*matrix.get(named[1], ()), *included]


def is_rehearsed(command):
    """Whether it is one command, of `make` or `.ci/run`, without anything that only a shell does."""
    program, *words = command.split()
    known = TARGETS if program == "make" else STEPS if program == ".ci/run" else set()
    named = re.sub(r"[A-Z]+=('[^']*'|\S*)", "", " ".join(words)).split()  # without variables of make
    return program in ("make", ".ci/run") and not re.search(r"[\n;&|<>`$]", command) and set(named) <= known


COMMANDS = [
    pytest.param(command, id=f"{workflow.stem}: {command}")
    for workflow in WORKFLOWS
    for step, matrix in steps(workflow)
    if "run" in step
    for command in expanded(step["run"], matrix)
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_workflow_runs_one_command_of_make_or_ci_run(command):
    assert is_rehearsed(command)
