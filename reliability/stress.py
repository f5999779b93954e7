# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Use one buffer from many threads, processes and forked children; check every answer, and that nothing grows.

A run consists of rounds of a few seconds. In each there are readers (single lookups, lookups at two times
and at many, listings, pickles), writers (late samples, pruning, histories that grow and shrink, a frame
that changes its parent), waits (blocking ones, awaits with timeouts, and futures that are answered,
cancelled or dropped), a message filter, calls of clear(), listeners that are created and destroyed while
another process publishes, and forked children. The numbers of a transform follow from its stamp, so each
answer can be checked. At the end of a round, the statistics must agree with what was inserted, each wait must
have ended or still lack its transform, and no thread may remain.

A tenth of the time before these rounds, several threads insert what one subscription to changes follows.

After each round, memory, threads and descriptors are read. After the first quarter of the rounds, they
may rise by less than 8 MB of resident memory, 4 MB of the C heap, 5000 of Python's blocks, and 1.5
threads or descriptors: a longer run detects smaller leaks.
"""

import argparse
import faulthandler
import logging
import random
import sys
import time
import warnings

from reliability.own_ros_domain import use_own_domain
from reliability.process_growth import BOUNDS, growth, sample

ROUND_S = 5.0
CHANGES_SHARE = 0.1  # of the time


def stress(seconds, seed):
    """Run rounds for this many seconds; return whether nothing went wrong."""
    import rclpy

    from reliability.stress_changes import follow_changes
    from reliability.stress_round import Round

    faulthandler.enable()
    # The test forks beside threads and copies a buffer with a node on purpose.
    warnings.filterwarnings("ignore", message=".*fork.*", category=DeprecationWarning)
    logging.getLogger("tf2_ros").setLevel(logging.ERROR)
    rclpy.init(args=[])
    # Late transforms are counted instead.
    rclpy.logging.set_logger_level("tf2_py", rclpy.logging.LoggingSeverity.ERROR)
    rng = random.Random(seed)
    sys.setswitchinterval(rng.choice((0.005, 0.0005, 0.00005)))
    totals, samples = {}, []
    end_s = time.monotonic() + seconds
    problems, rounds = follow_changes(seconds * CHANGES_SHARE)
    print(f"changes were followed {rounds} times", flush=True)
    while len(samples) < 2 or time.monotonic() < end_s:
        one = Round(rng.randrange(10**6))
        print(f"round {len(samples) + 1}: {one}", flush=True)
        problems += one.run(min(ROUND_S, seconds / 2))
        for what, done in one.counts.items():
            totals[what] = totals.get(what, 0) + done
        del one
        samples.append(sample())
        if problems:
            break
    rclpy.try_shutdown()
    problems += growth(samples)
    print(", ".join(f"{done} {what}" for what, done in sorted(totals.items())))
    for name in BOUNDS:
        print(f"{name:<12}", *(f"{one[name]:,}" for one in samples[:: max(1, len(samples) // 8)]))
    print(f"{'failed' if problems else 'passed'}, seed {seed}")
    print(*(f"PROBLEM: {text}" for text in problems), sep="\n", flush=True)
    return not problems


def main(arguments=None):
    """Return the exit status: 0 if everything was right and nothing grew."""
    parser = argparse.ArgumentParser(
        prog="python -m reliability.stress",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--minutes", type=float, default=2.0, help="how long (default: 2)")
    parser.add_argument("--seed", type=int, help="of an earlier run, which did the same in each thread")
    options = parser.parse_args(arguments)
    seed = random.randrange(10**6) if options.seed is None else options.seed
    print(f"Python {sys.version.split()[0]}, seed {seed}, ROS domain {use_own_domain()}", flush=True)
    return 0 if stress(options.minutes * 60, seed) else 1


if __name__ == "__main__":
    sys.exit(main())
