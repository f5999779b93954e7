"""Tries mutants of the engine against the tests: `python -m reliability.mutate --help`."""

import argparse
import hashlib
import json
import math
import os
import random
import re
import subprocess
import sys
import time
from pathlib import Path

from . import equivalent, sources

KILLED = {"failed", "crashed", "hung"}  # how a test ends that finds a mutant
VERDICTS = ("killed", "equivalent", "survived")


def draw(mutants, count, seed):
    """So many mutants, of each file by the root of how many it has; formulas would be the most otherwise."""
    by_file = {}
    for mutant in mutants:
        by_file.setdefault(mutant.file, []).append(mutant)
    weights = {file: math.sqrt(len(own)) for file, own in by_file.items()}
    order = random.Random(seed)
    drawn, left = [], []
    for file, own in by_file.items():
        order.shuffle(own)
        share = min(len(own), max(1, int(count * weights[file] / sum(weights.values()))))
        drawn += own[:share]
        left += own[share:]
    order.shuffle(left)
    return drawn + left[: max(0, count - len(drawn))]


def try_mutants(folder, all_sources, chosen, reasons, tests, budget, killers, out):
    """Yield the result of each mutant; progress is printed."""
    if not chosen:
        return
    states = sources.builds.BUILDS / f"{sources.NAME}-switch"
    reached = states / "reached"
    reached.write_bytes(bytes(sources.size(all_sources)))
    text = "".join(source.mutated() for source in all_sources)
    plan = {
        "library": str(states / "libtf2_mutants.so"),
        "reached": str(reached),
        "reach": str(states / "reach.json"),
        "sources": hashlib.sha256(text.encode()).hexdigest(),
        "mutants": [mutant.number for mutant in chosen],
        "tests": tests,
        "budget": budget,
        "listed": [mutant.number for mutant in chosen if mutant.key in reasons],
        "killers": {mutant.number: killers[mutant.key] for mutant in chosen if mutant.key in killers},
        "log": str(states / "pytest.log"),
    }
    plan_file = states / "plan.json"
    plan_file.write_text(json.dumps(plan))
    environment = {**os.environ, "PYTHONPATH": str(folder), "TF2_MUTANTS_REACHED": str(reached)}
    command = [sys.executable, "-m", "reliability.mutate.trials", str(plan_file)]
    with subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if line.startswith("{"):
                yield json.loads(line)
            else:
                print(line, end="", file=out, flush=True)
    if process.returncode != 0:
        raise SystemExit(f"the tests could not be run; what pytest says is in {plan['log']}")


def read_results(file):
    """By the keys of mutants, what the last run that tried them has found."""
    lines = file.read_text().splitlines() if file.exists() else []
    return {tuple(result["key"]): result for result in map(json.loads, lines)}


def table(mutants, results, reasons):
    """Lines: for each file how many mutants were tried, killed, equivalent, and survived."""
    rows = {}
    for mutant in mutants:
        row = rows.setdefault(mutant.file, dict.fromkeys(("mutants", *VERDICTS), 0))
        row["mutants"] += 1
        row[verdict(results[mutant.number], mutant, reasons)] += 1
    total = {name: sum(row[name] for row in rows.values()) for name in ("mutants", *VERDICTS)}
    yield f"{'file':34}{'mutants':>9}{'killed':>9}{'equivalent':>12}{'survived':>10}"
    for file, row in [*sorted(rows.items()), ("all", total)]:
        yield f"{file:34}{row['mutants']:9}{row['killed']:9}{row['equivalent']:12}{row['survived']:10}"
    of_all = total["killed"] / max(1, total["mutants"])
    of_different = total["killed"] / max(1, total["mutants"] - total["equivalent"])
    yield f"killed: {of_all:.1%} of all, {of_different:.1%} of those that are not equivalent"


def verdict(result, mutant, reasons):
    """``"killed"``, ``"equivalent"`` or ``"survived"``."""
    if result["outcome"] in KILLED:
        return "killed"
    return "equivalent" if mutant.key in reasons else "survived"


def main():
    """The program."""
    parser = argparse.ArgumentParser(
        prog="python -m reliability.mutate",
        description="Changes the engine's code in many small ways, and counts how many the tests notice.",
    )
    parser.add_argument("--count", type=int, default=250, help="how many mutants are drawn (default: 250)")
    parser.add_argument("--seed", type=int, default=1, help="which are drawn (default: 1)")
    parser.add_argument("--all", action="store_true", help="try every mutant: takes hours")
    parser.add_argument("--only", metavar="REGEX", help="those with this in the file, function or statement")
    parser.add_argument("--numbers", metavar="N", type=int, nargs="+", help="these mutants")
    parser.add_argument("--tests", metavar="FILE", nargs="+", default=[], help="run these tests alone")
    parser.add_argument(
        "--budget", metavar="S", type=float, default=0.0,
        help="give each mutant to tests of so many seconds at most, instead of to all that reach it",
    )  # fmt: skip
    parser.add_argument(
        "--resume", action="store_true", help="take over what earlier runs of the same code have found"
    )
    parser.add_argument("--list", action="store_true", help="print the mutants and try none")
    parser.add_argument("--minimum", type=float, default=95.0, help="percent to be killed (default: 95)")
    parser.add_argument("--compiler", default=os.environ.get("CC", "gcc"), help="as 'ccache gcc'")
    options = parser.parse_args()
    all_sources = sources.read()
    mutants = [mutant for source in all_sources for mutant in source.mutants]
    reasons, stale = equivalent.read({mutant.key for mutant in mutants})
    for key in stale:
        print(f"{equivalent.LIST.name}: there is no mutant {' | '.join(map(str, key))}", file=sys.stderr)
    chosen = [mutant for mutant in mutants if not options.only or re.search(options.only, mutant.diff())]
    if options.numbers:
        chosen = [mutant for mutant in chosen if mutant.number in options.numbers]
    elif not (options.all or options.only):
        chosen = draw(chosen, options.count, options.seed)
    if options.list:
        for mutant in chosen:
            print(f"{mutant.number} line {mutant.line}: {mutant.diff()}")
        return 0
    began = time.monotonic()
    folder = sources.build(all_sources, options.compiler)
    seconds = time.monotonic() - began
    print(f"{len(mutants)} mutants built in {seconds:.0f} s; {len(chosen)} are tried", flush=True)
    by_number = {mutant.number: mutant for mutant in mutants}
    results = {}
    began = time.monotonic()
    kept = Path(folder.parent, f"{sources.NAME}-switch", "results.jsonl")
    killers = {key: known["test"] for key, known in read_results(kept).items() if known["outcome"] in KILLED}
    if options.resume:
        earlier = read_results(kept)
        for mutant in chosen:
            known = earlier.get(mutant.key)
            if known is not None and (known["outcome"] in KILLED or mutant.key in reasons):
                results[mutant.number] = known
        print(f"{len(results)} were killed by an earlier run, or survived it and are listed as equivalent")
    to_try = [mutant for mutant in chosen if mutant.number not in results]
    with open(kept, "a") as file:
        for result in try_mutants(
            folder, all_sources, to_try, reasons, options.tests, options.budget, killers, sys.stdout
        ):
            mutant = by_number[result["mutant"]]
            results[mutant.number] = result
            file.write(json.dumps({**result, "key": mutant.key}) + "\n")
            file.flush()
            if verdict(result, mutant, reasons) == "survived":
                print(f"{result['outcome']}: {mutant.number} line {mutant.line}\n{mutant.diff()}", flush=True)
            if result.get("unsteady"):
                print(f"not the same again: {result['unsteady']} of {mutant.number}", flush=True)
    print(*table(chosen, results, reasons), sep="\n")
    print(f"{time.monotonic() - began:.0f} s; what killed each is in {kept}")
    verdicts = [verdict(results[mutant.number], mutant, reasons) for mutant in chosen]
    counted = len(verdicts) - verdicts.count("equivalent")
    return 0 if verdicts.count("killed") >= options.minimum / 100 * counted else 1


if __name__ == "__main__":
    sys.exit(main())
