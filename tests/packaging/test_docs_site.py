"""The site of the documentation: it builds without warnings, and its reference is complete."""

import importlib
import re
import subprocess
import sys

import pytest
from paths import ROOT
from processes import DEADLINE_S
from public_names import MODULES, OURS
from sources import PACKAGES

pytestmark = pytest.mark.ours


@pytest.mark.long("builds the site")
def test_it_builds_without_warnings(tmp_path):
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8")
    [options] = re.findall(r"-m sphinx (.*) -d build/doctrees docs build/docs", recipe)
    command = [sys.executable, "-m", "sphinx", *options.split(), "-d", tmp_path / "trees"]
    ended = subprocess.run(
        [*command, ROOT / "docs", tmp_path], text=True, capture_output=True, timeout=6 * DEADLINE_S
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


def documented():
    text = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "api").glob("*.rst"))
    found = set(re.findall(r"^\.\. auto(?:class|exception|function):: ([\w.]+)", text, re.MULTILINE))
    for module in re.findall(r"^\.\. automodule:: ([\w.]+)", text, re.MULTILINE):
        found |= {f"{module}.{name}" for name in importlib.import_module(module).__all__}
    for module, names in re.findall(
        r"^\.\. py:currentmodule:: (\S+)(.*?)(?=^\.\. py:current|\Z)", text, re.M | re.S
    ):
        found |= {f"{module}.{name}" for name in re.findall(r"^\.\. py:data:: (\w+)", names, re.MULTILINE)}
    return found


def is_ours(value):
    # Without modules, and without message classes and what else of rclpy can be imported here.
    return callable(value) and (getattr(value, "__module__", None) or "").partition(".")[0] in PACKAGES


def public():
    for module in PACKAGES[: PACKAGES.index("tf2_ros_tools")]:
        content = importlib.import_module(module)
        for name in {*vars(content), *OURS[module]} - {"add_dll_directories_from_env"}:
            if not name.startswith("_") and is_ours(getattr(content, name)):
                yield module, name
    tools = ("tf2_ros_tools.bag", "tf2_ros_tools.rerun", "tf2_ros_tools.urdf")
    for module in ("tf2_py.typing", "tf2_ros.numpy", "tf2_ros.records", *tools):
        yield from ((module, name) for name in MODULES[module])


def test_every_public_class_and_function_is_in_the_reference():
    described = documented()
    # tf2_ros repeats the names of tf2_py.
    missing = [
        f"{module}.{name}"
        for module, name in public()
        if not {f"{module}.{name}", f"tf2_py.{name}" if module == "tf2_ros" else ""} & described
    ]
    assert missing == []
