"""Owns counting the instructions of calls with callgrind, which a busy machine does not disturb."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.arena import OURS, Arena
from bench.peers import ours
from bench.processes import CONTESTANTS, Failure, clean_environment
from bench.rows import row_of

DUMPS_PER_CASE = 3  # up to the first mark; the shorter run; the run of twice as many calls
# As in counted.py, which only an interpreter with ROS can import.
BATCHED = "lookup_transforms", "set_transforms"
BATCHED_CALLS, SINGLE_CALLS = 10, 200
VECTOR_TIMES = 1000
COMMAND_S = 300

SECTION = "instructions"
# Case, what grows, to what sizes: as in bench.growth, but as large as callgrind has patience for.
GROWING = (
    ("Buffer.lookup_transform past", "samples", (100, 1000, 10_000)),
    ("lookup_transforms", "samples", (1000, 10_000)),
    ("Buffer.lookup_transform below", "ancestors", (10, 100, 500)),
)


def run(arena: Arena) -> None:
    """How instructions grow with history and depth, in a full run."""
    if not arena.sizes.thorough:
        return
    arena.say("instructions: callgrind")
    cases = {f"{case}={value}": (case, axis, value) for case, axis, values in GROWING for value in values}
    try:
        counts = count(list(cases))
    except Failure as failure:
        arena.absent.append({"who": OURS, "what": SECTION, "reason": str(failure)})
        return
    for name, (case, axis, value) in cases.items():
        per = VECTOR_TIMES if case == "lookup_transforms" else 1
        arena.rows.append(
            row_of(SECTION, OURS, case, {axis: value}, [[counts[name] / per]], unit="instructions")
        )


def count(cases: Sequence[str]) -> dict[str, float]:
    """
    Instructions of one call of each case of `contestants/counted.py`.

    The difference between two run lengths: start and end of the loop cancel. Failure where it cannot be had.
    """
    if shutil.which("valgrind") is None:
        raise Failure("valgrind is not installed")
    library = ours()
    with tempfile.TemporaryDirectory() as folder:
        command = [
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
        ]
        # Equal hashes, equal paths through dicts.
        environment = clean_environment({**library.environment, "PYTHONHASHSEED": "0"})
        try:
            subprocess.run(
                command, check=True, capture_output=True, text=True, timeout=COMMAND_S, env=environment
            )
        except subprocess.CalledProcessError as error:
            lines = [line for line in error.stderr.splitlines() if not line.startswith("==")] or ["no word"]
            raise Failure(f"it ended with {error.returncode}: {lines[-1]}") from None
        except subprocess.TimeoutExpired:
            raise Failure(f"it took longer than {COMMAND_S} s") from None
        totals = _totals(Path(folder))
    if len(totals) != DUMPS_PER_CASE * len(cases):
        raise Failure(f"callgrind wrote {len(totals)} counts, not {DUMPS_PER_CASE * len(cases)}")
    return {
        name: _per_call(name, totals[DUMPS_PER_CASE * i : DUMPS_PER_CASE * (i + 1)])
        for i, name in enumerate(cases)
    }


def _totals(folder: Path) -> list[int]:
    dumps = sorted((int(path.suffix[1:]), path) for path in folder.glob("counted.*.*"))
    return [int(re.findall(r"^totals: (\d+)", path.read_text(), re.MULTILINE)[0]) for _, path in dumps]


def _per_call(name: str, totals: Sequence[int]) -> float:
    return (totals[2] - totals[1]) / (BATCHED_CALLS if name.startswith(BATCHED) else SINGLE_CALLS)
