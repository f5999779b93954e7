# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check for ``make lint`` that Cython has no warnings and no performance hints for the packages given."""

import subprocess
import sys
import tempfile
from pathlib import Path

from build_backend.extensions import DIRECTIVES


def hints(source):
    """Get Cython's messages about one `.pyx`."""
    directives = [option for name, value in DIRECTIVES.items() for option in ("-X", f"{name}={value}")]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-m", "cython", *directives, "-o", str(Path(folder, "out.c")), str(source)],
            stderr=subprocess.PIPE,
            text=True,
        )
    return done.stderr


def main(packages):
    sources = [source for package in packages for source in sorted(Path(package).rglob("*.pyx"))]
    said = "".join(map(hints, sources))
    print(said, end="")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
