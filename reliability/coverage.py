# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Measure which lines the core's tests run: `python -m reliability.coverage`, behind `make coverage`.

gcov counts the lines of the compiled modules, in all processes, also where they run without the GIL.
pytest-cov counts those in Python, in the processes of the tests alone.
"""

import json
import os
import subprocess
import sys

from reliability.flagged_builds import BUILDS, build, in_processes

# What is not run, and why.
LEFT_OUT = {"tests/packaging": "reads sources, and builds the package"}
COMPILED = (".pyx", ".pxi", ".pxd")
SLOWNESS = 2  # of this build, for the deadlines of tests


def main(of_pytest=None):
    folder = build(
        "coverage", cflags=("--coverage",), ldflags=("--coverage",), CC=_unoptimised(), CYTHON_LINES="1"
    )
    for counts in folder.rglob("*.gcda"):
        counts.unlink()
    packages = sorted(path.parent.name for path in folder.glob("tf2_*/__init__.py"))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *in_processes(3)]
    command += ["--cov-report=", *(f"--cov={package}" for package in packages)]
    command += [f"--ignore={name}" for name in LEFT_OUT]
    # In one of its tests, a thread outruns this build.
    command += ["-k", "not test_it_succeeds_while_later_transforms"]
    command += (sys.argv[1:] if of_pytest is None else of_pytest) or ["tests"]
    environment = {**os.environ, "PYTHONPATH": str(folder), "TF2_TEST_SLOWNESS": str(SLOWNESS)}
    status = subprocess.run(command, cwd=folder, env=environment).returncode
    report(folder)
    return status


def report(folder):
    """Print the share of lines that ran: of each file in which more than a tenth did not, and of all."""
    coverage = [sys.executable, "-m", "coverage", "json", "-q", "-o", "-"]
    of_python = json.loads(subprocess.check_output(coverage, cwd=folder))
    files = {
        name: (one["summary"]["covered_lines"], one["summary"]["num_statements"])
        for name, one in of_python["files"].items()
    }
    files |= {name: (sum(lines.values()), len(lines)) for name, lines in _compiled_lines(folder).items()}
    for name, (covered, total) in sorted(files.items()):
        if covered < 0.9 * total:
            print(f"{name}: {covered} of {total} lines")
    for kind, endings in {"Python": (".py",), "Cython": COMPILED}.items():
        counts = [count for name, count in files.items() if name.endswith(endings)]
        covered, total = map(sum, zip(*counts, strict=True))
        print(f"{kind}: {covered:,} of {total:,} lines, {100 * covered / total:.1f} %")


def _compiled_lines(folder):
    """By file and line, whether any module that has the line ran it."""
    found = {}
    for counts in folder.rglob("*.gcda"):
        told = subprocess.check_output(["gcov", "--json-format", "--stdout", counts], cwd=folder)
        for file in json.loads(told)["files"]:
            if file["file"].startswith("tf2_") and file["file"].endswith(COMPILED):
                lines = found.setdefault(file["file"], {})
                for line in file["lines"]:
                    number = line["line_number"]
                    lines[number] = lines.get(number, False) or line["count"] > 0
    return found


def _unoptimised():
    """A compiler that leaves each line its own code; the build's flags would ask for -O3."""
    BUILDS.mkdir(exist_ok=True)
    compiler = BUILDS / "unoptimised-cc"
    compiler.write_text('#!/bin/sh\nexec gcc "$@" -O0\n')
    compiler.chmod(0o755)
    return str(compiler)


if __name__ == "__main__":
    sys.exit(main())
