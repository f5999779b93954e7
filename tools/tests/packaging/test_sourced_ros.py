# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where a ROS 2 is sourced: the tools in a workspace built by colcon, and in a Python with the core."""

import os
import shutil

import installing
import pytest
from sourced_installations import INDEX, Installation, Workspace, distribution_with_tf2, sourced
from tool_paths import TOOLS
from tool_project import PYPROJECT

pytestmark = [
    pytest.mark.long("builds and installs both projects"),
    pytest.mark.skipif("AMENT_PREFIX_PATH" in os.environ, reason="the ROS 2 to source is made of the wheels"),
]

PREFIX_OF_TOOLS = "from ament_index_python import get_package_prefix as of; print(of('tf2_ros_tools'))"


def copy_tools(target):
    """The tools' own files, without anything built."""
    shutil.copytree(TOOLS, target, ignore=shutil.ignore_patterns(*installing.BUILT, "tests", "docs", ".*"))
    return target


def add_tools(checkout):
    """Put the tools into a checkout, and beside it the link that the docs advise."""
    copy_tools(checkout / "tools")
    (checkout.parent / "tf2-ros-tools").symlink_to("tf2-ros-cython/tools")


@pytest.fixture(scope="module")
def ros(tmp_path_factory):
    return distribution_with_tf2(tmp_path_factory.mktemp("ros") / "ros")


@pytest.fixture(scope="module", params=[[], ["--symlink-install"]], ids=["copied", "linked"])
def workspace(request, ros, tmp_path_factory):
    path = tmp_path_factory.mktemp("workspace") / "colcon"
    return Workspace(path, ros, *request.param, packages=add_tools)


def test_two_packages_are_built(workspace):
    installed = workspace.path / "install"
    names = {path.name for path in installed.iterdir() if path.is_dir()}
    assert names == {"tf2_ros_cython", "tf2_ros_tools"}
    prefix = installed / "tf2_ros_tools"
    assert [marker.name for marker in (prefix / INDEX).iterdir()] == ["tf2_ros_tools"]
    assert (prefix / "share" / "tf2_ros_tools" / "package.xml").is_file()


def test_programs_are_where_ros2_run_looks_and_start(workspace, ros):
    folder = f"{workspace.run(sourced(ros), '-c', PREFIX_OF_TOOLS).stdout.strip()}/lib/tf2_ros_tools"
    assert {*os.listdir(folder)} == {*PYPROJECT["project"]["scripts"]}
    started = workspace.start(sourced(ros), f"{folder}/tf2_echo", "-h")
    assert started.stdout.startswith("usage: tf2_echo "), started.stderr
    # It imports our tf2_ros, and a node of the ROS that is sourced.
    wrong = workspace.start(sourced(ros), f"{folder}/tf2_echo", "map", "base_link", "--wait", "0")
    assert (wrong.returncode, wrong.stderr.count("Traceback")) == (1, 0), wrong.stderr
    assert "base_link" in wrong.stderr + wrong.stdout


def test_pip_installs_the_tools_beside_the_core(ros, tmp_path):
    project = installing.checkout_copy(tmp_path / "project")
    installing.reuse_builds(project)
    quick = installing.unoptimised(tmp_path, os.environ)
    core = installing.build("build_backend.build_wheel", project, tmp_path / "core", environment=quick)
    sources = copy_tools(tmp_path / "tools")
    tools = installing.build("setuptools.build_meta.build_wheel", sources, tmp_path / "made")
    python = installing.new_venv(tmp_path / "venv", core)
    alone = Installation(python, tmp_path / "venv")
    said = alone.run(sourced(ros), "-m", "tf2_ros_cython").stdout
    assert [line for line in said.splitlines() if line.startswith("tools: ")] == [
        "tools: not installed; in a clone of tf2-ros-cython, pip install './tools[cli]' adds tf2_echo and "
        "others; in a colcon workspace, link the folder tools into src and build"
    ]
    installing.pip_install(python, tools)
    both = alone.run(sourced(ros), "-m", "tf2_ros_tools.programs.tf2_echo", "-h")
    assert both.stdout.startswith("usage: tf2_echo "), both.stderr
    said = alone.run(sourced(ros), "-m", "tf2_ros_cython").stdout
    assert "tools: not installed" not in said
