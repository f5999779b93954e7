"""Owns the report on failing allocations: of each operation how many there are, and what became of each."""

import argparse
import sys
import tempfile

from reliability.builds import ROOT

sys.path.insert(0, str(ROOT / "tests"))

from test_allocation_failures import injections, table

__all__ = ["main"]


def main(args=None):
    """
    Let allocations fail, and print a table.

    :return: the exit status: 1 where a failure did anything but raise.
    """
    parser = argparse.ArgumentParser(
        prog="python -m reliability.allocations",
        description="Let each allocation of each operation of a buffer fail, one by one.",
        epilog="engine: what the project's own C code asks for, alone and with all that follow. all: what "
        "is asked for in the same thread, Python's objects included, alone.",
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
