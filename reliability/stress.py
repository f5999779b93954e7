"""
Use one buffer from many threads, processes and forked children at once, and check every answer.

There are readers (single lookups, lookups at two times and at many, listings, pickles), writers (late
samples, pruning, histories that grow and shrink, a frame that changes its parent), waits (blocking ones,
awaits with timeouts, and futures that are answered, cancelled or dropped), calls of clear(), listeners that
are created and destroyed while another process publishes, and forked children. In every second round, the
buffer is shared with a reader in another process. The numbers of a transform follow from its stamp, so each
answer can be checked. At the end, the statistics must agree with what was inserted, each wait must have ended
or still lack its transform, and no thread may remain.
"""

import argparse
import logging
import random
import sys
import time
import warnings

from reliability import pythons
from reliability.own_domain import use_own_domain

ROUND_S = 10.0


def stress(seconds, seed):
    """Run rounds for this many seconds; return whether nothing went wrong."""
    import faulthandler

    import rclpy

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
    count = max(2, round(seconds / ROUND_S))
    problems, totals, began = [], {}, time.monotonic()
    for number in range(count):
        one = Round(rng.randrange(10**6), is_shared=number % 2 == 0)
        kind = "shared" if one.is_shared else "private"
        print(f"round {number + 1} of {count}: {kind} buffer, seed {one.seed}", flush=True)
        problems += one.run(seconds / count)
        for what, done in one.counts.items():
            totals[what] = totals.get(what, 0) + done
        if problems:
            break
    rclpy.try_shutdown()
    print(", ".join(f"{done} {what}" for what, done in sorted(totals.items())))
    print(
        f"{'failed' if problems else 'passed'} after {time.monotonic() - began:.0f} s, seed {seed}",
        flush=True,
    )
    return not problems


def main(arguments=None):
    """The exit status: 0 where everything was right."""
    parser = argparse.ArgumentParser(
        prog="python -m reliability.stress",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="how long (default: 60)")
    parser.add_argument("--seed", type=int, help="of an earlier run, which did the same in each thread")
    pythons.add_arguments(parser)
    options = parser.parse_args(arguments)
    seed = random.randrange(10**6) if options.seed is None else options.seed
    if options.all_pythons:
        command = ["-m", "reliability.stress", "--seconds", str(options.seconds), "--seed", str(seed)]
        return pythons.run_on_all(command, options.python)
    print(f"Python {sys.version.split()[0]}, seed {seed}, ROS domain {use_own_domain()}", flush=True)
    return 0 if stress(options.seconds, seed) else 1


if __name__ == "__main__":
    sys.exit(main())
