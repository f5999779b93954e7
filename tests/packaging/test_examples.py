"""The examples: each runs, ends cleanly, and needs what the README says and nothing else."""

import ast
import importlib.util
import os
import re
import signal
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from paths import ROOT
from processes import DEADLINE_S
from sources import PACKAGES, imports

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

pytestmark = pytest.mark.ours

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
each = pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)

# What each of the longer ones prints before it waits for something: interrupted then, it is not at its end.
WAITS_AFTER = {
    "buffer_server": "the client waits",
    "demo": "Where the camera is in the map",
    "message_filter": "scan of 1.00 s",
}
INTERRUPTED = 128 + signal.SIGINT  # the exit status, as shells count it


def start(example, **popen):
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    return subprocess.Popen(
        [sys.executable, example], env=environment, text=True, stdout=subprocess.PIPE, **popen
    )


@each
def test_an_example_runs_and_ends_by_itself(example):
    with start(example, stderr=subprocess.PIPE) as process:
        _, errors = process.communicate(timeout=3 * DEADLINE_S)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors


@pytest.mark.parametrize("name", WAITS_AFTER)
def test_an_example_ends_cleanly_on_ctrl_c(name, tmp_path):
    example = ROOT / "examples" / f"{name}.py"
    for attempt in range(ATTEMPTS):
        status, errors = interrupted(example, WAITS_AFTER[name], tmp_path / f"errors_{attempt}")
        if OF_RCLPY not in errors:
            break
    assert status == INTERRUPTED, errors
    assert "Traceback" not in errors


# What rclpy's bindings make of a Ctrl-C in the instant in which they convert an argument.
OF_RCLPY = "RuntimeError: Unable to convert call argument"
ATTEMPTS = 3


def interrupted(example, line, errors):
    """The exit status and standard error of an example that gets a Ctrl-C after it has printed a line."""
    with errors.open("w") as stderr, start(example, stderr=stderr, start_new_session=True) as process:
        try:
            assert any(line in printed for printed in process.stdout)
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the whole group
            process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
    return process.returncode, errors.read_text()


@each
def test_an_example_says_what_it_shows_and_how_to_run_it(example):
    what, *_ = text = ast.get_docstring(ast.parse(example.read_text(encoding="utf-8"))).splitlines()
    assert what.endswith(".")
    assert f"Run: python examples/{example.name}" in text
    assert [line for line in text if line.startswith("Ends by itself")]


# What the examples import, and from where.


def extra_of_the_readme():
    """The extra that the README names for the examples."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    [extra] = re.findall(r"\[examples\]\(examples\):[^.]*`\[([\w-]+)\]`", readme)
    return extra


def installed_with(names):
    """The distributions that these requirements bring, as far as they are installed; canonical names."""
    found, left = set(), [Requirement(name) for name in names]
    while left:
        wanted = left.pop()
        if (name := canonicalize_name(wanted.name)) in found:
            continue
        try:
            needs = map(Requirement, metadata.requires(name) or ())
        except metadata.PackageNotFoundError:
            continue
        found.add(name)
        extras = [{"extra": extra} for extra in wanted.extras] or [{"extra": ""}]
        left += [one for one in needs if not one.marker or any(map(one.marker.evaluate, extras))]
    return found


def is_of_a_sourced_ros(module):
    prefixes = [
        Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix
    ]
    origin = Path(importlib.util.find_spec(module).origin)
    return any(prefix in origin.parents for prefix in prefixes)


@each
def test_an_example_needs_no_more_than_the_extra_that_the_readme_names(example):
    brought = installed_with(
        [
            *PROJECT["dependencies"],
            # Also the extra of another ROS 2, as ros-kilted: the one that is not here is passed over.
            *(
                one
                for name, requirements in PROJECT["optional-dependencies"].items()
                if name.partition("-")[0] == extra_of_the_readme()
                for one in requirements
            ),
        ]
    )
    owners = metadata.packages_distributions()
    modules = {one.module.partition(".")[0] for one in imports(example)} - sys.stdlib_module_names
    foreign = modules - set(PACKAGES)
    assert foreign
    missing = [
        module
        for module in foreign
        if not brought & set(map(canonicalize_name, owners.get(module, ())))
        and not is_of_a_sourced_ros(module)
    ]
    assert missing == []


def test_an_import_from_elsewhere_would_be_found():
    brought = installed_with([*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["ros"]])
    assert "numpy" in brought
    assert not brought & {"scipy", "pytest", "hypothesis"}
