# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Count instructions with callgrind, regardless of the load of the machine.

`python -m bench.instruction_counts` compares the instructions of a few calls with
`instruction_baseline.json`, as multiples of the instructions of a reference, a piece of pure Python. A count
that has fallen fails, too, because an old baseline would hide the next regression. `--renew` writes a new
baseline.

The kind of processor does not matter: on every x86-64 machine with AVX2, valgrind presents the same one,
without AVX-512, to NumPy, glibc and our own functions with clones for AVX2. The build of Python matters, and
the count of the reference identifies it. With another build, only calls that cost much more fail.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.libraries import PROGRAMS, last_line, ours
from bench.programs.call_texts import CALLS, EMPTY
from release.child_environment import environment_of_children

BASELINE = Path(__file__).resolve().parent / "instruction_baseline.json"
REFERENCE = "reference"
# Cases of programs/counted_calls.py, and how many calls the shorter run makes.
CASES = {
    REFERENCE: 200,
    "Buffer.lookup_transform static": 200,
    "Buffer.lookup_transform past": 200,
    "Buffer.lookup_transform latest": 200,
    "set_transform": 200,
    "set_transforms_cdr": 10,
    "lookup_transforms": 10,
    EMPTY: 200,
    **dict.fromkeys(CALLS, 200),
}
DUMPS_PER_CASE = 3  # up to the first mark; the shorter run; the run of twice as many calls
SEEDS = (0, 1, 2)
TOLERANCE = 0.10
# The calls as programs make them; those that run much code in Python vary more.
TOLERANCES = {
    call: 0.05
    if call.startswith("await") or call == "buffer.lookup_transform(target, source, newer)"
    else 0.03
    for call in CALLS
}
# The share of a call's instructions that the interpreter executes differs between builds of Python.
TOLERANCE_OTHER_PYTHON = 0.30
# How far the reference's count may differ in the same build.
TOLERANCE_REFERENCE = 0.02


def count(seed: int) -> dict[str, float]:
    """
    Instructions of one call of each case.

    The difference between two run lengths: start and end of the loop cancel; of CALLS, the empty loop is
    subtracted. The seed of Python's hashes decides which names collide in its cache of attributes, which
    costs up to 15 % more.
    """
    library = ours()
    with tempfile.TemporaryDirectory() as folder:
        command = ["valgrind", "--quiet", "--tool=callgrind", "--dump-before=getpgid", "--combine-dumps=no"]
        # A Python with ROS wheels starts itself anew with their libraries on its path.
        command += ["--trace-children=yes", f"--callgrind-out-file={folder}/counted.%p"]
        command += [library.python, str(PROGRAMS / "counted_calls.py")]
        command += [f"{name}={calls}" for name, calls in CASES.items()]
        # Equal hashes, equal paths through dicts.
        environment = environment_of_children(
            PYTHONHASHSEED=str(seed), PYTHONOPTIMIZE="1", **library.environment
        )
        subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
        dumps = sorted((int(path.suffix[1:]), path) for path in Path(folder).glob("counted.*.*"))
        totals = [int(re.findall(r"^totals: (\d+)", path.read_text(), re.M)[0]) for _, path in dumps]
    shorter, longer = totals[1::DUMPS_PER_CASE], totals[2::DUMPS_PER_CASE]
    found = {
        name: (more - less) / calls
        for (name, calls), less, more in zip(CASES.items(), shorter, longer, strict=True)
    }
    empty = found.pop(EMPTY)
    return {name: instructions - empty * (name in CALLS) for name, instructions in found.items()}


def verdict(ratio: float, before: float | None, allowed: float) -> str:
    if before is None:
        return "no baseline"
    if ratio > before * (1 + allowed):
        return "slower"
    return "faster" if ratio < before * (1 - allowed) else "as before"


def compare(present: Mapping[str, Any], baseline: Mapping[str, Any]) -> int:
    """Print how the ratios differ; 1: they differ too much."""
    same_python = (
        present["python"] == baseline["python"]
        and abs(present["reference"] / baseline["reference"] - 1) <= TOLERANCE_REFERENCE
    )
    print(
        "guard: instructions of a call, and as multiples of the reference's, within this share of the "
        "baseline\n"
        f"  Python {present['python']}, reference {present['reference']}; "
        f"the baseline: Python {baseline['python']}, reference {baseline['reference']}"
    )
    refused = {"slower", "no baseline", "faster"} if same_python else {"slower", "no baseline"}
    failed = False
    for case, ratio in present["ratios"].items():
        before = baseline["ratios"].get(case)
        allowed = TOLERANCES.get(case, TOLERANCE) if same_python else TOLERANCE_OTHER_PYTHON
        found = verdict(ratio, before, allowed)
        failed |= found in refused
        was = "" if before is None else f"(was {before:.3f} ± {allowed:.0%})"
        print(f"  {case:82}{ratio * present['reference']:8.0f}{ratio:8.3f} {was}  {found}")
    if failed:
        print(
            "guard: failed. If the change is wanted, run python -m bench.instruction_counts --renew "
            "and give the reason in the commit."
        )
    return int(failed)


def main(arguments: Sequence[str] | None = None) -> int:
    description = "Count the instructions of a few calls, and fail if a count has changed."
    parser = argparse.ArgumentParser(prog="python -m bench.instruction_counts", description=description)
    parser.add_argument("--renew", action="store_true", help="write the present counts as the new baseline")
    renew = parser.parse_args(arguments).renew
    if shutil.which("valgrind") is None:
        print("guard: skipped, valgrind is not installed")
        return 0
    try:
        runs = [count(seed) for seed in SEEDS]
    except subprocess.CalledProcessError as error:
        print(f"guard: failed: exit status {error.returncode}, {last_line(error.stderr)}")
        return 1
    counts = {name: statistics.mean(run[name] for run in runs) for name in runs[0]}
    reference = counts.pop(REFERENCE)
    present = {
        "python": ".".join(platform.python_version_tuple()[:2]) + " " + platform.machine(),
        "reference": round(reference),
        "ratios": {case: round(instructions / reference, 4) for case, instructions in counts.items()},
    }
    if renew:
        BASELINE.write_text(json.dumps(present, indent=2) + "\n")
        print(f"guard: {BASELINE.name} renewed")
    return compare(present, json.loads(BASELINE.read_text()))


if __name__ == "__main__":
    sys.exit(main())
