"""Report on failing allocations: how many each operation makes, and what became of each."""

import argparse
import sys
import tempfile

from reliability.builds import ROOT

sys.path.insert(0, str(ROOT / "tests" / "support"))

from failing_allocations import injections, table

__all__ = ["main"]


def main(args=None):
    """
    Let allocations fail, and print a table.

    :return: the exit status: 1 where a failure did anything but raise.
    """
    parser = argparse.ArgumentParser(
        prog="python -m reliability.allocations",
        description="Let each allocation of each operation of a buffer fail, one by one.",
        epilog="engine: allocations of the project's C code, each once by itself and once with all later "
        "ones. all: all allocations of the same thread, including Python's objects, each by itself.",
    )
    parser.add_argument("scope", nargs="?", choices=["engine", "all"], default="engine")
    parser.add_argument("operations", nargs="*", help="their names, as in the table; default: all")
    chosen = parser.parse_args(args)
    with tempfile.TemporaryDirectory() as folder:
        results = injections(chosen.scope, folder, *chosen.operations)
    print(table(results))
    for one in results:
        for found in one["found"]:
            print(f"\n{one['operation']}: {found}")
    return 1 if any(one["found"] for one in results) else 0


if __name__ == "__main__":
    sys.exit(main())
