# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What gets installed of the tools."""

import importlib.metadata
import shutil
import tarfile
import zipfile

import installing
import pytest
from packaging.requirements import Requirement
from project_sources import PYPROJECT as CORE
from tool_paths import TOOLS
from tool_project import PYPROJECT

HOOKS = "setuptools.build_meta"


@pytest.fixture
def project(tmp_path):
    ignored = shutil.ignore_patterns(*installing.BUILT, ".*")
    return shutil.copytree(TOOLS, tmp_path / "project", ignore=ignored)


def test_an_install_needs_numpy_and_a_core_that_fits():
    needed = [Requirement(text) for text in importlib.metadata.requires("tf2-ros-tools")]
    always = {one.name: one for one in needed if one.marker is None}
    assert always.keys() == {"numpy", "tf2-ros-cython"}
    assert CORE["project"]["version"] in always["tf2-ros-cython"].specifier


def test_the_manifest_has_the_version_of_the_project():
    manifest = (TOOLS / "package.xml").read_text(encoding="utf-8")
    assert f"<version>{PYPROJECT['project']['version']}</version>" in manifest


def test_the_wheel_holds_the_tools_alone(project, tmp_path):
    made = installing.build(f"{HOOKS}.build_wheel", project, tmp_path / "made")
    assert made.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(made) as opened:
        held = {name for name in opened.namelist() if ".dist-info/" not in name and ".data/" not in name}
    sources = (path for path in (TOOLS / "tf2_ros_tools").rglob("*") if path.suffix in (".py", ".typed"))
    assert held == {path.relative_to(TOOLS).as_posix() for path in sources} | {"tf2_ros_tools/py.typed"}


def test_the_source_distribution_holds_tests_pages_and_samples(project, tmp_path):
    with tarfile.open(installing.build(f"{HOOKS}.build_sdist", project, tmp_path / "made")) as opened:
        held = {name.partition("/")[2] for name in opened.getnames()}
    assert {"package.xml", "setup.cfg", "LICENSE", "resource/tf2_ros_tools", "tf2_ros_tools/py.typed"} <= held
    assert {"tests/conftest.py", "docs/recordings.md", "docs/samples/drive/drive.mcap", "demo.py"} <= held
