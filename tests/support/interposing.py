"""Build libraries that replace functions of the C library in the tests' programs."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from paths import SUPPORT

SOURCES = SUPPORT / "interposed"


def built(name, folder):
    """Compile `interposed/<name>.c`; the path of the library. Without a compiler the test is skipped."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    library = Path(folder, f"{name}.so")
    options = ["-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O2", "-shared", "-fPIC"]
    subprocess.run([compiler, *options, "-o", library, SOURCES / f"{name}.c", "-ldl"], check=True)
    return library


def with_library(library, **variables):
    """The environment of a program that loads it."""
    # After the runtime of a sanitizer, which must be the first.
    before = os.environ.get("LD_PRELOAD", "")
    return {**os.environ, "LD_PRELOAD": f"{before} {library}".strip(), **variables}
