# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Run the tests with releases of rclpy: `python -m release.rclpy_release_tests`, behind `make releases`.

An overlay is an archive with another release of rclpy, compiled for one Python, which replaces that of the
wheels when it comes first on PYTHONPATH. The wheels of the project are installed beside those of ROS, and the
tests of nodes, with the recorded programs of users, run with the wheels alone and with each overlay. What no
release can change is tested once, by turns.

An overlay may also be the real tf2, compiled for Jazzy: beside it, the tests run that hold for both,
`pytest --reference`.
"""

import argparse
import re
import subprocess
import sys
import tarfile
from pathlib import Path

from release import wheels
from release.interpreters import interpreters

# rclpy-<its version>-<the wheels that it is compiled with, after "on-" of another release>-cp<Python>.tar.xz
# tf2-<its version>-cp<Python>.tar.xz
NAMES = re.compile(r"(?:rclpy-[\d.]+-(?:on-)?(?P<ros>\w+)|tf2-[\d.]+)-cp(?P<python>\d{3,})")
WHEELS_OF_TF2 = "jazzy"
FOLDER = wheels.ROOT.parent / "shared" / "ros"
OF_NODES = wheels.ROOT / "tests" / "ros"
# Files that test nothing of executors, tasks, clients or receivers, which are what differs between releases.
BY_TURNS = """
ages arguments buffer_interface waits_while_system_time_is_set max_age max_age_random faulty_middleware
frame_prefix rcl_declarations inbox_without_middleware readers_beside_writers records tf2_msgs
""".split()


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m release.rclpy_release_tests",
        description="Run the tests of nodes with the wheels of Jazzy and Kilted, and with overlays on them; "
        "run the tests marked tf2 beside each real tf2.",
        epilog="Further arguments go to pytest.",
    )
    parser.add_argument(
        "--folder", type=Path, default=FOLDER, help="where the archives are; default: %(default)s"
    )
    parser.add_argument(
        "--only", metavar="WORD", action="append", default=[], help="those with this word in their names"
    )
    options, of_pytest = parser.parse_known_args(arguments)
    archives = sorted([*options.folder.glob("rclpy-*.tar.xz"), *options.folder.glob("tf2-*.tar.xz")])
    print(f"{len(archives)} overlays in {options.folder}")
    found = [(archive, NAMES.fullmatch(archive.name.removesuffix(".tar.xz"))) for archive in archives]
    for archive, name in found:
        if name is None:
            parser.error(f"{archive.name}: expected a name like rclpy-7.1.11-jazzy-cp311.tar.xz")
    pythons = {name["python"] for _, name in found} or {"311"}
    runs = list(_runs(found, sorted(pythons), options))
    for word in options.only:
        if not any(word in name for name, *_ in runs):
            print(f"skipped: no {word} in {options.folder}")
    if not runs:
        return 0
    results, environments = {}, {}
    sources = wheels.source_distributions(sorted({ros for _, _, ros, _ in runs}))
    of_nodes = [name for name, *_ in runs if not name.startswith("tf2-")]
    for name, python, ros, archive in runs:
        executable = interpreters([])[python]
        if executable is None:
            results[name] = f"Python {python} not found"
            continue
        if (python, ros) not in environments:
            environments[python, ros] = _environment(executable, python, ros, sources)
        if name in of_nodes:
            tests = of_pytest or _tests_of_nodes(of_nodes.index(name), len(of_nodes))
        else:
            tests = ["--reference", *(of_pytest or ["tests"])]
        results[name] = _tested(environments[python, ros], name, archive, tests)
    for name, result in results.items():
        print(f"{name}: {result}")
    return 0 if set(results.values()) == {"passed"} else 1


def _runs(found, pythons, options):
    """What to test: its name, a version of Python, a release of ROS 2, and the overlay, if it is one."""
    for python in pythons:
        for ros in wheels.RELEASES:
            of_it = [
                archive
                for archive, name in found
                if (name["python"], name["ros"] or WHEELS_OF_TF2) == (python, ros)
            ]
            for archive in (None, *of_it):
                name = archive.name.removesuffix(".tar.xz") if archive else f"wheels of {ros}"
                if any(word in name for word in options.only or [""]):
                    yield name, f"{python[0]}.{python[1:]}", ros, archive


def _tests_of_nodes(number, count):
    """For pytest, in one of so many runs."""
    by_turns = [path.name for one in BY_TURNS for path in sorted(OF_NODES.glob(f"test_{one}.py"))]
    elsewhere = [one for at, one in enumerate(by_turns) if at % count != number]
    return ["tests/ros", *(f"--ignore=tests/ros/{one}" for one in elsewhere)]


def _environment(executable, version, ros, sources):
    """A Python with the wheels of a ROS 2, those of the project, and what its short tests use."""
    python = wheels.environment_of(executable, wheels.SCRATCH / f"overlays-{version}-{ros}")
    engine, messages = (wheels.wheel(executable, version, sources[what]) for what in ("engine", ros))
    extras = ",".join([*wheels.RELEASES[ros], "test"])
    wheels.run(
        [
            python,
            "-m",
            "pip",
            "install",
            "--quiet",
            f"tf2-ros-cython[{extras}] @ file://{engine}",
            f"tf2-ros-cython-msgs-{ros} @ file://{messages}",
        ]
    )
    return python


def _tested(python, name, archive, tests):
    environment = wheels.environment()
    if archive is not None:
        with tarfile.open(archive) as opened:
            opened.extractall(wheels.SCRATCH, filter="data")
        overlay = wheels.SCRATCH / name
        # Tests read ROS's headers beside rclpy.
        (overlay / "include").unlink(missing_ok=True)
        (overlay / "include").symlink_to(python.parents[1] / "include")
        environment["PYTHONPATH"] = str(next(overlay.glob("lib/python3.*/site-packages")))
    suite = wheels.SCRATCH / "suite-overlays"
    wheels.copy_suite(suite)
    print(f"== {name}", flush=True)
    command = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *wheels.IN_PROCESSES, *tests]
    return "passed" if subprocess.run(command, cwd=suite, env=environment).returncode == 0 else "failed"


if __name__ == "__main__":
    sys.exit(main())
