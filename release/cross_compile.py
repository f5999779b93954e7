# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Compile for 64-bit ARM on x86-64: `python -m release.cross_compile`, behind `make cross`.

Compiles every extension, and runs the tests that need no ROS under qemu. A compiler, and libraries and a
Python for ARM, are unpacked into .cross; nothing is installed.
"""

import argparse
import fcntl
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from Cython.Build import cythonize

from build_backend import extensions

from . import unpacking_debs

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / ".cross"

# Of NumPy's wheels, whose headers are used.
PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_27_aarch64", "manylinux_2_28_aarch64")
# Tests of the engine that need no ROS, start no second Python, and map little memory: qemu emulates one
# process, and slowly what maps many pages.
TESTS = """
test_unknown_frame_advice test_recorded_answers test_lookup_error_texts test_buffer_limits
test_buffer_memory test_history_search test_table_of_names test_listings test_copies_in_one_state
test_buffer_without_node test_waits_without_node test_printable test_lookups_at_many_times
test_many_times_beside_writers test_waiters
""".split()
OF_TESTS = ["pytest>=9", "pytest-timeout", "hypothesis", "PyYAML"]


class Unavailable(Exception):
    """What compiles for ARM cannot be had here."""


@dataclass(frozen=True)
class Tools:
    """How to compile for ARM, and how to run Python there."""

    compiler: list[str]
    environment: dict[str, str]  # of the compiler
    suffix: str  # of an extension's file
    headers: list[Path]
    site: Path  # the wheels
    python: list[str]


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m release.cross_compile", description=__doc__.split("\n\n")[1]
    )
    parser.add_argument("--untested", action="store_true", help="compile, and run no tests")
    options, of_pytest = parser.parse_known_args(arguments)
    try:
        tools = fetch_tools()
    except Unavailable as error:
        print(f"unavailable: {error}")
        return 1
    checkout, refused = build(tools)
    for module, errors in refused.items():
        print(f"{module}\n{errors}")
    if refused or options.untested:
        return 1 if refused else 0
    return test(tools, checkout, of_pytest)


def fetch_tools():
    """Fetch what compiles for ARM into .cross, once; raises Unavailable."""
    FOLDER.mkdir(exist_ok=True)
    with open(FOLDER / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            return _fetch()
        except (OSError, subprocess.CalledProcessError) as error:
            raise Unavailable(f"{error} {getattr(error, 'stderr', None) or ''}".strip()) from error


def _fetch():
    target = unpacking_debs.unpack(
        FOLDER / "debian-arm64", ["python3", "libpython3-dev", "libstdc++6"], "arm64"
    )
    here = unpacking_debs.unpack(
        FOLDER / "debian-amd64", ["gcc-aarch64-linux-gnu", "qemu-user-static"], "amd64"
    )
    compiler = [str(here / "usr/bin/aarch64-linux-gnu-gcc"), f"--sysroot={target}", "-pthread"]
    environment = {"LD_LIBRARY_PATH": str(here / "usr/lib/x86_64-linux-gnu")}
    [python] = target.glob("usr/bin/python3.[0-9]*[0-9]")
    headers = [target / "usr/include" / python.name, target / "usr/include"]
    version = python.name.removeprefix("python")
    suffix = f".cpython-{version.replace('.', '')}-aarch64-linux-gnu.so"
    run = [str(here / "usr/bin/qemu-aarch64-static"), "-L", str(target), str(python)]
    return Tools(compiler, environment, suffix, headers, _install(version), run)


def _install(version):
    """Install ARM's wheels for a version of Python into a folder of their own, once."""
    folder = FOLDER / f"site-{version}"
    done = folder / "installed"
    if not done.exists():
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
        command += ["--target", str(folder), "--python-version", version]
        command += [word for platform in PLATFORMS for word in ("--platform", platform)]
        subprocess.run([*command, "numpy", *OF_TESTS], check=True, capture_output=True, text=True)
        done.touch()
    return folder


def build(tools, *options):
    """
    Compile all extensions into a copy of the sources; return it, and the errors of each that failed.

    :param options: further ones of the compiler.
    """
    checkout = FOLDER / "checkout"
    _copy_sources(checkout)
    sources = {one.name: _generate(one) for one in extensions.cython_extensions(ROOT)}
    [of_numpy] = tools.site.glob("numpy/_core/include")
    command = [*tools.compiler, *extensions.COMPILE_ARGS, *extensions.NO_DEBUG_ARGS, "-DNDEBUG", "-fPIC"]
    command += ["-Werror=implicit-function-declaration", "-shared", *options]
    command += [f"-I{folder}" for folder in (*tools.headers, of_numpy, checkout)]

    def compile_one(module):
        made = checkout / f"{module.replace('.', '/')}{tools.suffix}"
        ended = subprocess.run(
            [*command, str(sources[module]), "-o", str(made), "-lm"],
            capture_output=True,
            text=True,
            env={**os.environ, **tools.environment},
        )
        return ended.stderr if ended.returncode else ""

    with ThreadPoolExecutor(os.cpu_count()) as several:
        errors = dict(zip(sources, several.map(compile_one, sources), strict=True))
    print(f"{len(errors)} extensions", flush=True)
    return checkout, {module: text for module, text in errors.items() if text}


def _copy_sources(folder):
    shutil.rmtree(folder, ignore_errors=True)
    # Also what is not committed yet.
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def _generate(module):
    """The C of an extension, which is the same for all processors."""
    [done] = cythonize(
        module, build_dir=str(FOLDER / "c"), compiler_directives=extensions.DIRECTIVES, quiet=True
    )
    return Path(done.sources[0]).absolute()


def test(tools, checkout, of_pytest=()):
    """Run the tests that need no ROS with Python for ARM; the exit status of pytest."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "AMENT_"))}
    environment |= {
        "PYTHONPATH": str(tools.site),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [*tools.python, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    command += of_pytest or [f"tests/core/{name}.py" for name in TESTS]
    return subprocess.run(command, cwd=checkout, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())
