"""Let allocations fail in `programs/allocations.py`, and report what became of each operation."""

import json
import subprocess
import sys

from interposing import built, with_library
from paths import PROGRAMS


def injections(scope, folder, *operations):
    """What `programs/allocations.py` prints: of each operation a dict."""
    variables = {"PYTHONMALLOC": "malloc"} if scope == "all" else {}
    done = subprocess.run(
        [sys.executable, str(PROGRAMS / "allocations.py"), scope, *operations],
        env=with_library(built("allocations", folder), **variables),
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def table(results):
    """One line for each operation: its allocations, and how often one failed."""
    lines = [f"{'operation':45} allocations  injected"]
    for one in results:
        told = f"  {len(one['found'])} wrong" if one["found"] else ""
        lines.append(f"{one['operation']:45} {one['allocations']:11} {one['injected']:9}{told}")
    lines.append(f"{len(results)} operations, {sum(one['injected'] for one in results)} injections")
    return "\n".join(lines)
