# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Prove one commit, by `make prove`: `python -m release.prove [COMMIT]`.

Runs each step in a new clone of the commit, and writes a line for it into docs/development/proofs.md. A step
that has a line is not repeated, so an interrupted run may be continued. Logs are in build/proofs.
"""

import datetime
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections import namedtuple
from pathlib import Path

from release import cyclonedds
from release.child_environment import environment_of_children
from release.interpreters import VERSIONS, interpreters
from release.proved_commit import PAGE, changed_since, clone, git, is_known

ROOT = Path(__file__).resolve().parent.parent
PAGE_HEAD = """# Proofs

Which tests and checks ran on the commit that was proved last, and with which result? `make prove` writes this
page ([how](release.md#proofs)). A step without tests counts as one.

Commit: {}

"""
COLUMNS = "step command passed failed skipped minutes date machine versions notes".split()
NOT_RUN = "not run, because "
ARCHIVES = Path("shared", "ros")  # beside the checkout, see release/rclpy_release_tests.py
RCLPY = ["rclpy-3.3.21-on-jazzy", "wheels of jazzy", "rclpy-7.1.11-jazzy", "wheels of kilted"]
RCLPY += ["rclpy-9.1.5-kilted", "rclpy-10.0.10-on-kilted", "rclpy-11.0.0-on-kilted"]
TF2 = ["tf2-0.36.20", "tf2-0.41.7", "tf2-0.46.0"]
# These replace functions of Fast DDS, which rcl is linked with.
NOT_WITH_CYCLONE = '--ignore=tests/ros/test_faulty_middleware.py -k "not middleware_without_the_event"'
# What steps print: the last lines of each run of pytest, and of `make coverage`.
SUMMARY = re.compile(r"^=* ?(?:\d+ \w+(?:, )?)+ in [\d.]+s.*$", re.MULTILINE)
COUNT = re.compile(r"(\d+) (passed|failed|error|skipped)")
RAN_WITH = re.compile(r"^ran with (.*)$", re.MULTILINE)
COVERED = re.compile(r"^(?:Python|Cython): [\d,]+ of [\d,]+ lines, [\d.]+ %$", re.MULTILINE)

Step = namedtuple("Step", "name command has_tests lacks", defaults=(True, ""))


def steps(root=ROOT):
    """All of them, in their order: those that find most faults in least time come first."""
    python, archives = interpreters(), [path.name for path in (root.parent / ARCHIVES).glob("*.tar.xz")]
    yield Step("lint", ["make", "lint"], has_tests=False)
    yield Step("README's commands in a fresh clone", ["make", "bare"])
    yield Step("core, all tests", ["make", "test-core-all"])
    yield Step("tools, all tests", ["make", "-C", "tools", "test-all"])
    yield Step("guard", ["make", "guard"], False, "" if shutil.which("valgrind") else "there is no valgrind")
    yield Step("docs", ["make", "docs"], has_tests=False)
    yield Step("stress", ["make", "stress", "MINUTES=5"], has_tests=False)
    for kind in ("address", "thread"):
        yield Step(f"sanitizers, {kind}", ["make", "sanitize", f"OPTIONS={kind}"])
    lacks = "" if shutil.which("clang-14") else "there is no clang 14"
    yield Step("fuzzing", ["make", "fuzz", "OPTIONS=--seconds 120"], False, lacks)
    yield Step("coverage", ["make", "coverage"])
    for version in VERSIONS:
        options = f"OPTIONS=--only {version}{'' if version == '3.12' else ' --short'}"  # Jazzy's has 3.12
        lacks = "" if python[version] else f"there is no Python {version}"
        yield Step(f"installed wheels, Python {version}", ["make", "wheels", options], lacks=lacks)
    for name in (*RCLPY, *TF2):
        archive = next((one for one in archives if one.startswith(f"{name}-")), "")
        lacks = "" if archive or name.startswith("wheels") else "there is no archive of it"
        lacks = lacks or ("" if python["3.11"] else "there is no Python 3.11")
        what, tests = ("beside the real", "") if name in TF2 else ("tests of nodes,", " tests/ros")
        yield Step(f"{what} {name}", ["make", "releases", f'OPTIONS=--only "{name}"{tests}'], lacks=lacks)
    lacks = "" if (root / cyclonedds.PYTHON).exists() else "`python -m release.cyclonedds` did not run"
    command = ["make", "test-core", f"TESTS=tests/ros {NOT_WITH_CYCLONE}", f"PY={cyclonedds.PYTHON}"]
    yield Step("tests of nodes, Cyclone DDS", command, lacks=lacks)


def read_page(root=ROOT):
    """The commit that the page names, or None, and its lines by the names of their steps."""
    text = (root / PAGE).read_text(encoding="utf-8")
    commit = re.search(r"^Commit: (\w+)$", text, re.MULTILINE)
    rows = [line[2:-2].split(" | ") for line in text.splitlines() if line.startswith("| ")][2:]
    return commit and commit[1], {row[0]: dict(zip(COLUMNS, row, strict=True)) for row in rows}


def main(named=None, found=None, root=ROOT):
    proved, lines = read_page(root)
    goes_on = named is None and proved and is_known(proved, root) and not changed_since(proved, root)
    commit = proved if goes_on else git(root, "rev-parse", "--verify", f"{named or 'HEAD'}^{{commit}}")
    lines, place = lines if commit == proved else {}, None
    for step in steps(root) if found is None else found:
        line = lines.get(step.name)
        if line and (step.lacks or not line["notes"].startswith(NOT_RUN)):
            continue
        place = place if step.lacks or place else _new_clone(root, commit)
        facts = {"notes": NOT_RUN + step.lacks} if step.lacks else _run(step, place)
        facts |= {"step": step.name, "command": f"`{shlex.join(step.command)}`"}
        lines[step.name] = {name: facts.get(name, "") for name in COLUMNS}
        rows = [COLUMNS, ["---"] * len(COLUMNS), *(line.values() for line in lines.values())]
        table = "".join(f"| {' | '.join(row)} |\n" for row in rows)
        (root / PAGE).write_text(PAGE_HEAD.format(commit) + table, encoding="utf-8")
    return 1 if any(line["failed"] not in ("", "0") for line in lines.values()) else 0


def _new_clone(root, commit):
    """A clone of the commit that finds the archives and the Cyclone DDS of this checkout."""
    place = clone(root, commit, root / "build" / "proofs" / "clone")
    for name, beside, of in ((ARCHIVES, place.parent, root.parent), (cyclonedds.PYTHON.parent, place, root)):
        (beside / name).unlink(missing_ok=True)
        (beside / name).parent.mkdir(exist_ok=True)
        (beside / name).symlink_to(of / name)
    return place


def _run(step, place):
    """Run a step in a clone; return what its line says of it."""
    print(f"== {step.name}: {shlex.join(step.command)}", flush=True)
    begin, log = time.monotonic(), place.parent / f"{re.sub(r'[^a-z0-9.]+', '-', step.name.lower())}.log"
    # Without what `make prove` was called with.
    variables = {name: text for name, text in environment_of_children().items() if "MAKE" not in name}
    with open(log, "wb") as to:
        status = subprocess.call(step.command, cwd=place, env=variables, stdout=to, stderr=to)
    counts = counts_of(step, output := log.read_text(encoding="utf-8", errors="replace"), status)
    print(f"   failed, see {log}" if counts["failed"] else "   passed", flush=True)
    return {name: f"{count:,}" for name, count in counts.items()} | {
        "minutes": f"{(time.monotonic() - begin) / 60:.1f}",
        "date": datetime.date.today().isoformat(),
        "machine": f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}",
        "versions": "; ".join(dict.fromkeys(RAN_WITH.findall(output))) or f"Python {sys.version.split()[0]}",
        "notes": "; ".join(COVERED.findall(output)),
    }


def counts_of(step, output, status):
    """How many tests passed, failed and were skipped. A step in which none passed has failed."""
    counts = dict.fromkeys(("passed", "failed", "skipped"), 0)
    for number, what in COUNT.findall("\n".join(SUMMARY.findall(output))):
        counts["failed" if what == "error" else what] += int(number)
    counts["passed"] = counts["passed"] if step.has_tests else int(status == 0)
    counts["failed"] = counts["failed"] or int(status != 0 or not counts["passed"])
    return counts


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
