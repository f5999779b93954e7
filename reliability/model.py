"""
Compare the buffer with a slow model of tf2, in random steps and queries.

tests/core/test_model.py does the same for half a minute. A failure prints the steps that reproduce it;
`--replay FILE` runs them again.
"""

import argparse
import ast
import random
import signal
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "support"))

from model_steps import as_text, quiet, run, search


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m reliability.model", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**9))
    parser.add_argument("--replay", type=Path, help="a file with steps as a failure prints them")
    options = parser.parse_args()
    with quiet():
        if options.replay:
            broken = run(ast.literal_eval(options.replay.read_text()))
            print(broken or "buffer and model agree")
            return bool(broken)
        print(f"seed {options.seed}", flush=True)
        end = time.monotonic() + options.seconds
        stopped = threading.Event()
        signal.signal(signal.SIGINT, lambda *_: stopped.set())  # ends it after the sequence under way
        counts, found = search(options.seed, lambda: stopped.is_set() or time.monotonic() >= end)
    outcomes = ", ".join(f"{name} {count:,}" for name, count in sorted(counts.items()))
    print(f"{counts['steps']:,} steps, {counts['queries']:,} queries; {outcomes}")
    if found is None:
        print("buffer and model agree")
        return 0
    broken, steps = found
    print(f"{broken}\n{as_text(steps)}")
    return 1


if __name__ == "__main__":
    sys.exit(main())
