# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An environment without ROS, with the tools and all of their libraries: recordings need no more."""

import project_sources
import pytest
from environment_without_ros import make_world
from project_sources import modules
from tool_pages import provide_torch, run_program
from tool_paths import DOCS, TOOLS
from tool_project import PACKAGES, PYPROJECT

pytestmark = pytest.mark.long("makes an environment without ROS 2")

EXTRAS = ("bag", "fleet", "cli", "web", "plot", "zenoh", "dds", "foxglove")


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    core, tools = project_sources.PYPROJECT["project"], PYPROJECT["project"]
    wanted = ["pytest", "pandas", *core["dependencies"], "scipy"]
    wanted += [one for extra in EXTRAS for one in tools["optional-dependencies"][extra]]
    return make_world(tmp_path_factory.mktemp("without_ros"), wanted, TOOLS / "tf2_ros_tools")


def test_what_is_about_recordings_loads(world):
    names = [*modules(TOOLS, PACKAGES)]
    names.remove("tf2_ros_tools.nodes.node_session")
    assert "tf2_ros_tools.diagnosis.stream_statistics" in names and "tf2_ros_tools.programs.tf2_bag" in names
    world.does(f"""
import importlib, sys
for name in {names!r}:
    importlib.import_module(name)
assert not {{"rclpy", "geometry_msgs", "tf2_msgs"}} & {{*sys.modules}}
""")


@pytest.mark.parametrize("command", ["tf2_echo map camera", "tf2_check", "view_frames"])
def test_a_program_says_in_one_line_what_is_missing(world, command):
    name, *arguments = command.split()
    ended = world.run("-m", f"tf2_ros_tools.programs.{name}", *arguments)
    assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (1, "", 1)
    assert ended.stderr.startswith(f"{name}: this needs ROS 2, but {world.python} finds no rclpy")
    assert "; or listen without ROS 2: --live dds://;" in ended.stderr


@pytest.mark.parametrize(
    "page", ["recordings.md", "poses-and-joint-states.md", "saved-buffers.md", "datasets.md"]
)
def test_the_pages_about_recordings_hold(world, tmp_path, page):
    if page == "datasets.md":
        provide_torch(tmp_path)
    run_program(DOCS / page, tmp_path, world.python, world.environment)
