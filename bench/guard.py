"""
Count instructions with callgrind, regardless of the load of the machine.

`python -m bench.guard` compares the instructions of a few calls with `guard_baseline.json`, as multiples of
the instructions of a piece of pure Python, which depend on the machine and on Python in the same way.
`--renew` writes a new baseline.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.peers import ours
from bench.processes import CONTESTANTS, Failure, run_command

DUMPS_PER_CASE = 3  # up to the first mark; the shorter run; the run of twice as many calls
# As in counted.py, which only an interpreter with ROS can import.
BATCHED = "lookup_transforms", "set_transforms"
BATCHED_CALLS, SINGLE_CALLS = 10, 200

BASELINE = Path(__file__).resolve().parent / "guard_baseline.json"
REFERENCE = "reference"
CASES = (
    "Buffer.lookup_transform static",
    "Buffer.lookup_transform past",
    "Buffer.lookup_transform latest",
    "set_transform",
    "set_transforms_cdr",
    "lookup_transforms",
)
TOLERANCE = 0.10
# The share of a call's instructions that the interpreter executes differs between versions.
TOLERANCE_OTHER_PYTHON = 0.30


def count(cases: Sequence[str]) -> dict[str, float]:
    """
    Instructions of one call of each case of `contestants/counted.py`.

    The difference between two run lengths: start and end of the loop cancel. Failure without valgrind.
    """
    if shutil.which("valgrind") is None:
        raise Failure("valgrind is not installed")
    library = ours()
    with tempfile.TemporaryDirectory() as folder:
        run_command(
            "valgrind",
            "--tool=callgrind",
            "--dump-before=getpgid",
            "--combine-dumps=no",
            # A Python with ROS wheels starts itself anew with their libraries on its path.
            "--trace-children=yes",
            f"--callgrind-out-file={folder}/counted.%p",
            library.command[0],
            str(CONTESTANTS / "counted.py"),
            *cases,
            # Equal hashes, equal paths through dicts.
            environment={**library.environment, "PYTHONHASHSEED": "0"},
        )
        dumps = sorted((int(path.suffix[1:]), path) for path in Path(folder).glob("counted.*.*"))
        totals = [int(re.findall(r"^totals: (\d+)", path.read_text(), re.M)[0]) for _, path in dumps]
    if len(totals) != DUMPS_PER_CASE * len(cases):
        raise Failure(f"callgrind wrote {len(totals)} counts, not {DUMPS_PER_CASE * len(cases)}")
    shorter, longer = totals[1::DUMPS_PER_CASE], totals[2::DUMPS_PER_CASE]
    return {
        name: (more - less) / (BATCHED_CALLS if name.startswith(BATCHED) else SINGLE_CALLS)
        for name, less, more in zip(cases, shorter, longer, strict=True)
    }


def python_series() -> str:
    return ".".join(platform.python_version_tuple()[:2])


def tolerance(baseline: Mapping[str, Any]) -> float:
    return TOLERANCE if baseline["python"] == python_series() else TOLERANCE_OTHER_PYTHON


def compare(
    ratios: Mapping[str, float], baseline: Mapping[str, Any], allowed: float
) -> list[tuple[str, str]]:
    """(case, verdict) of each: "slower" and "no baseline" are failures."""
    verdicts = []
    for case, ratio in ratios.items():
        before = baseline["ratios"].get(case)
        if before is None:
            verdict = "no baseline"
        elif ratio > before * (1 + allowed):
            verdict = "slower"
        elif ratio < before * (1 - allowed):
            verdict = "faster"
        else:
            verdict = "as before"
        verdicts.append((case, verdict))
    return verdicts


def main(arguments: Sequence[str] | None = None) -> int:
    description = "Count the instructions of a few calls, and fail if a count has grown."
    parser = argparse.ArgumentParser(prog="python -m bench.guard", description=description)
    parser.add_argument("--renew", action="store_true", help="write the present counts as the new baseline")
    renew = parser.parse_args(arguments).renew
    try:
        counts = count([REFERENCE, *CASES])
    except Failure as failure:
        if "not installed" in str(failure):
            print(f"guard: skipped, {failure}")
            return 0
        print(f"guard: failed: {failure}")
        return 1
    ratios = {case: round(counts[case] / counts[REFERENCE], 4) for case in CASES}
    if renew:
        BASELINE.write_text(json.dumps({"python": python_series(), "ratios": ratios}, indent=2) + "\n")
        print(f"guard: {BASELINE.name} renewed")
    baseline = json.loads(BASELINE.read_text())
    allowed = tolerance(baseline)
    print(
        f"guard: instructions of a call as multiples of the reference's {counts[REFERENCE]:.0f}, "
        f"within {allowed:.0%} of CPython {baseline['python']}'s baseline"
    )
    failed = False
    for case, verdict in compare(ratios, baseline, allowed):
        failed |= verdict in ("slower", "no baseline")
        before = baseline["ratios"].get(case, float("nan"))
        print(f"  {case:34}{counts[case]:10.0f}{ratios[case]:9.3f} (was {before:.3f})  {verdict}")
    if failed:
        print("guard: failed. Where the cost is wanted: python -m bench.guard --renew, and say why.")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
