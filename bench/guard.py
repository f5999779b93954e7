"""
Owns the guard against silent slow-downs: `python -m bench.guard`, and `--renew` to accept what is now.

Instructions of a few calls, as multiples of those of a piece of pure Python, which stands for machine and
Python, against the committed `guard_baseline.json`.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench import instructions
from bench.processes import Failure

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
# Another Python's share of a call's instructions is not quite the reference's.
TOLERANCE_OTHER_PYTHON = 0.30


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
    parser = argparse.ArgumentParser(prog="python -m bench.guard", description="Guard against slow-downs.")
    parser.add_argument("--renew", action="store_true", help="write what is counted now as the new baseline")
    renew = parser.parse_args(arguments).renew
    try:
        counts = instructions.count([REFERENCE, *CASES])
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
