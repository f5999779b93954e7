# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Run the steps of docs/development/proofs.md that are due, by `make prove`: `python -m release.prove`.

Each step runs one command. Its result is kept in `release/proofs.json`, with the commit and a hash of the
files that the step reads; a step whose files have not changed since it passed is not due, and is not run
again. So a run may end at any time, and the next one continues.
"""

import argparse
import datetime
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from release import cyclonedds, proof_pages
from release.interpreters import VERSIONS, interpreters

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path("release", "proofs.json")
# Archives with other releases of ROS, see release/rclpy_release_tests.py.
OVERLAYS = ROOT.parent / "shared" / "ros"
REAL_TF2 = ("tf2-0.36.20", "tf2-0.41.7", "tf2-0.46.0")
# What is made of results is no reason to repeat a step.
MADE = (str(KEPT), str(proof_pages.PAGE))

PACKAGES = ("tf2_py/*", "tf2_ros/*", "tf2_geometry_msgs/*", "tf2_sensor_msgs/*", "tf2_ros_cython/*")
BUILD = ("setup.py", "setup.cfg", "pyproject.toml", "build_backend/*", "messages/*", "Makefile", "step.mk")
CORE = (*PACKAGES, *BUILD)
TESTS_OF_NODES = ("tests/ros/*", "tests/support/*", "tests/conftest.py")
# Tests of the core read pages, the release's scripts, and the requirements of the tools.
SUITE = (
    *CORE,
    "tests/*",
    "docs/*",
    "examples/*",
    "release/*",
    "reliability/*",
    "bench/*",
    ".github/*",
    ".ci/*",
)
SUITE += ("*.md", "*.rst", "*.toml", "*.yaml", "package.xml", "resource/*", "LICENSE*", "tools/*.toml")
SUITE += ("tools/package.xml", "tools/docs/*", "tools/README.md")
INSTALLERS = "rclpy_release_tests wheels interpreters child_environment cyclonedds unpacking_debs"
INSTALLERS = tuple(f"release/{name}.py" for name in INSTALLERS.split())
TOOLS = (*CORE, "tools/*", "tests/support/*", "docs/*", "README.md")
EVERYTHING = ("*",)
# The last line of pytest, and of each of its runs in one command.
COUNT = re.compile(r"(\d+) (passed|failed|errors?|skipped)\b")
# The last lines of `make coverage`.
COVERED = re.compile(r"^(Python|Cython): ([\d,]+ of [\d,]+ lines, [\d.]+ %)$", re.MULTILINE)
SUMMARY = re.compile(r"^=* ?(?:\d+ \w+(?:, )?)+ in [\d.]+s.*$", re.MULTILINE)


@dataclass(frozen=True)
class Step:
    """
    One thing to prove.

    :param command: what proves it, in the folder of the repository.
    :param reads: patterns of the tracked files on which its result depends.
    :param lacks: what it needs and this machine does not have; ``""``: nothing.
    """

    name: str
    command: tuple[str, ...]
    reads: tuple[str, ...]
    lacks: str = ""


def steps():
    """All of them, in the order in which they run: those that find most faults in least time come first."""
    yield Step("lint", ("make", "lint"), EVERYTHING)
    yield Step("README's commands in a fresh clone", ("make", "bare"), EVERYTHING)
    yield Step("core, all tests", ("make", "test-core-all"), SUITE)
    yield Step("tools, all tests", ("make", "-C", "tools", "test-all"), TOOLS)
    answers = ("make", "test-core", "TESTS=tests/core/test_recorded_answers.py")
    yield Step("recorded answers", answers, (*CORE, "tests/core/*", "tests/support/*", "tests/conftest.py"))
    lacks = "" if shutil.which("valgrind") else "no valgrind"
    yield Step("guard", ("make", "guard"), (*CORE, "bench/*.py", "bench/*.json"), lacks)
    yield Step("docs", ("make", "docs"), (*CORE, "docs/*", "tools/docs/*", "tools/tf2_ros_tools/*", "*.md"))
    yield Step("stress", ("make", "stress", "MINUTES=5"), (*CORE, "reliability/*"))
    for kind in ("address", "thread"):
        command = ("make", "sanitize", f"OPTIONS={kind}")
        reads = (*CORE, "tests/*", "tools/*", "reliability/*")
        yield Step(f"sanitizers, {kind}", command, reads)
    # Short, because it is repeated after each change of the code; the nightly workflow searches longer.
    command = ("make", "fuzz", "OPTIONS=--seconds 120")
    yield Step("fuzzing", command, (*CORE, "reliability/*", "tools/tests/fuzz/*", "tools/tf2_ros_tools/*"))
    yield Step("coverage", ("make", "coverage"), (*CORE, "tests/core/*", *TESTS_OF_NODES, "reliability/*"))
    found = interpreters([])
    for version in VERSIONS:
        lacks = "" if found[version] else f"no Python {version}"
        command = ("make", "wheels", f"OPTIONS=--only {version}")
        yield Step(f"installed wheels, Python {version}", command, (*SUITE, *TOOLS), lacks)
    yield from _releases()
    for name in REAL_TF2:
        lacks = "" if any(OVERLAYS.glob(f"{name}-*.tar.xz")) else "no archive of it"
        reads = (*CORE, "tests/*", *INSTALLERS)
        yield Step(f"beside the real {name}", ("make", "releases", f"OPTIONS=--only {name}"), reads, lacks)


def _releases():
    reads = (*CORE, *TESTS_OF_NODES, *INSTALLERS)
    for name in proof_pages.RELEASES:
        lacks = (
            "" if name.startswith("wheels") or any(OVERLAYS.glob(f"{name}-*.tar.xz")) else "no archive of it"
        )
        # All tests of nodes, which CI runs by turns.
        command = ("make", "releases", f'OPTIONS=--only "{name}" tests/ros')
        yield Step(f"tests of nodes, {name}", command, reads, lacks)
    lacks = "" if (ROOT / cyclonedds.PYTHON).exists() else "python -m release.cyclonedds did not run"
    # These take functions away from a middleware, and find those of Fast DDS, which rcl is linked with.
    tests = 'tests/ros --ignore=tests/ros/test_faulty_middleware.py -k "not middleware_without_the_event"'
    command = ("make", "test-core", f"TESTS={tests}", f"PY={cyclonedds.PYTHON}")
    yield Step("tests of nodes, Cyclone DDS", command, reads, lacks)


def hash_of(step, tracked):
    """What a result depends on: the contents of what the step reads, and its command."""
    read = [
        f"{name} {content}"
        for name, content in sorted(tracked.items())
        if name not in MADE and any(fnmatchcase(name, pattern) for pattern in step.reads)
    ]
    return hashlib.sha256("\n".join([*step.command, *read]).encode()).hexdigest()[:16]


def tracked_files(root=ROOT):
    """By name, what stands for the content of each tracked file, without what `make prove` writes into it."""
    listed = subprocess.check_output(["git", "ls-tree", "-r", "-z", "HEAD"], cwd=root, text=True)
    rows = (line.partition("\t") for line in listed.split("\0") if line)
    tracked = {name: facts.split()[2] for facts, _, name in rows}
    for name in proof_pages.MARKED_PAGES:
        text = subprocess.check_output(["git", "show", f"HEAD:{name}"], cwd=root, text=True)
        tracked[name] = proof_pages.without_proofs(text)
    return tracked


def results(root=ROOT):
    """The kept results by the names of their steps."""
    kept = root / KEPT
    return json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}


def is_of(step, kept, tracked):
    """Whether a result is kept of this step with the files of now."""
    return kept.get(step.name, {}).get("hash") == hash_of(step, tracked)


def due(found, kept, tracked):
    """The steps that have not passed with the files of now; those that cannot run here are none."""
    return [
        one
        for one in found
        if not one.lacks and not (is_of(one, kept, tracked) and kept[one.name]["failed"] == 0)
    ]


def counts_of(output, status):
    """How many tests passed, failed and were skipped; a command without tests passes or fails once."""
    counted = dict.fromkeys(("passed", "failed", "skipped"), 0)
    for line in SUMMARY.findall(output):
        for number, what in COUNT.findall(line):
            counted["failed" if what.startswith("error") else what] += int(number)
    if not counted["passed"] + counted["failed"]:
        counted["failed" if status else "passed"] = 1
    elif status and not counted["failed"]:
        counted["failed"] = 1
    return counted


def run(step, root, tracked):
    """Run a step, and return its result."""
    print(f"== {step.name}: {shlex.join(step.command)}", flush=True)
    commit = subprocess.check_output(["git", "rev-parse", "--short=8", "HEAD"], cwd=root, text=True).strip()
    begin = time.monotonic()
    log = root / "build" / "proofs" / f"{re.sub(r'[^a-z0-9.]+', '-', step.name.lower())}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    # What `make prove` was called with, such as OPTIONS, is not for the commands of make that it runs.
    environment = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MFLAGS")}
    with open(log, "w", encoding="utf-8") as written:
        status = subprocess.run(
            step.command, cwd=root, env=environment, stdout=written, stderr=subprocess.STDOUT
        ).returncode
    output = log.read_text(encoding="utf-8", errors="replace")
    cores = len(os.sched_getaffinity(0))
    result = {
        **counts_of(output, status),
        "commit": commit,
        "date": datetime.date.today().isoformat(),
        "machine": f"{cores} cores, {platform.machine()}, Python {platform.python_version()}",
        "minutes": round((time.monotonic() - begin) / 60, 1),
        "hash": hash_of(step, tracked),
    }
    if covered := dict(COVERED.findall(output)):
        result["covered"] = covered
    print(f"   {'failed, see ' + str(log) if result['failed'] else 'passed'}", flush=True)
    return result


def keep(found, kept, tracked, root=ROOT):
    """Write the results and the pages. What this machine cannot prove again has no result of other files."""
    now = {}
    for one in found:
        if one.lacks and not is_of(one, kept, tracked):
            now[one.name] = {"lacks": one.lacks}
        elif one.name in kept and "lacks" not in kept[one.name]:
            now[one.name] = kept[one.name]
    (root / KEPT).write_text(json.dumps(now, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    (root / proof_pages.PAGE).write_text(proof_pages.page(found, now), encoding="utf-8")
    for name in proof_pages.MARKED_PAGES:
        text = (root / name).read_text(encoding="utf-8")
        (root / name).write_text(proof_pages.with_proofs(text, now), encoding="utf-8")


def changed_files(tracked, root=ROOT):
    """What is not committed, except for what this writes."""
    lines = subprocess.check_output(["git", "status", "--porcelain"], cwd=root, text=True).splitlines()
    changed = {line[3:] for line in lines} - {*MADE}
    for name in changed & {*proof_pages.MARKED_PAGES}:
        if proof_pages.without_proofs((root / name).read_text(encoding="utf-8")) == tracked[name]:
            changed.remove(name)
    return sorted(changed)


def main(arguments=None, found=None, root=ROOT):
    parser = argparse.ArgumentParser(
        prog="python -m release.prove",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--list", action="store_true", help="only name the steps that are due")
    parser.add_argument("--only", default="", metavar="WORD", help="only those with this word in their names")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no step after this time")
    options = parser.parse_args(arguments)
    found, kept, tracked = list(steps() if found is None else found), results(root), tracked_files(root)
    todo = [one for one in due(found, kept, tracked) if options.only in one.name]
    if todo and not options.list and (changed := changed_files(tracked, root)):
        parser.error(f"commit first, because a proof has a commit: {', '.join(changed)}")
    if not options.list:
        keep(found, kept, tracked, root)
    if options.list or not todo:
        print(*[one.name for one in todo] or ["nothing is due"], sep="\n")
        return 0
    end = time.monotonic() + options.minutes * 60
    for one in todo:
        if time.monotonic() < end:
            tracked = tracked_files(root)
            kept[one.name] = run(one, root, tracked)
            keep(found, kept, tracked, root)
    return 1 if any(kept.get(one.name, {}).get("failed") for one in todo) else 0


if __name__ == "__main__":
    sys.exit(main())
