"""An environment without ROS, with the extensions of this checkout: buffers and recordings need no more."""

import pickle
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import installing
import pytest
from pages import program, run_program
from paths import ROOT
from processes import DEADLINE_S
from sources import PYPROJECT, modules

pytestmark = [pytest.mark.ours, pytest.mark.long("makes an environment without ROS 2")]

RECORDINGS = ROOT / "docs" / "recordings.md"
EXTRAS = ("bag", "fleet", "rerun", "scipy", "cli", "plot")
# What works without ROS, and some names that need it.
WITH = {"Buffer", "BufferCore", "BufferInterface", "LookupException", "TransformStamped", "format_transform"}
WITHOUT = {"BufferClient", "MessageFilter", "StaticTransformListener", "Time", "TransformListener"}
LACKING = (
    "tf2_ros.buffer_client",
    "tf2_ros.buffer_server",
    "tf2_ros.message_filter",
    "tf2_ros.static_transform_broadcaster",
    "tf2_ros.static_transform_listener",
    "tf2_ros.transform_broadcaster",
    "tf2_ros.transform_listener",
    "tf2_geometry_msgs",
    "tf2_sensor_msgs",
)


@dataclass
class World:
    """A Python without ROS, and what its environment has to say for that."""

    python: Path
    environment: dict[str, str]
    folder: Path

    def run(self, *arguments, **environment):
        return subprocess.run(
            [self.python, *arguments],
            cwd=self.folder,
            env=self.environment | environment,
            text=True,
            capture_output=True,
            timeout=3 * DEADLINE_S,
        )

    def does(self, code):
        """What a program prints that must succeed, in silence but for that."""
        ended = self.run("-c", code)
        assert (ended.returncode, ended.stderr) == (0, "")
        return ended.stdout

    def lacks(self, code):
        """The last line of what a program says that must fail."""
        ended = self.run("-c", code)
        assert ended.returncode == 1
        return ended.stderr.splitlines()[-1]


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    made = tmp_path_factory.mktemp("without_ros")
    extras = PYPROJECT["project"]["optional-dependencies"]
    wanted = [*PYPROJECT["project"]["dependencies"], *(one for extra in EXTRAS for one in extras[extra])]
    wanted = [one for one in wanted if one != "argcomplete"]
    libraries = installing.link_libraries(made / "libraries", "pytest", "hypothesis", "pandas", *wanted)
    for package in (*installing.OURS, "tf2_ros_tools", "tf2_ros_cython"):
        (libraries / package).symlink_to(ROOT / package)
    environment = {**installing.unsourced(), "PYTHONPATH": str(libraries), "MPLBACKEND": "agg"}
    return World(installing.new_venv(made / "venv"), environment, made)


class TestNames:
    def test_each_works_or_says_what_to_install(self, world):
        world.does(f"import tf2_ros; [getattr(tf2_ros, name) for name in {sorted(WITH)}]")
        for name in WITHOUT:
            said = world.lacks(f"import tf2_ros; tf2_ros.{name}")
            assert f"tf2_ros.{name} needs ROS 2, and no rclpy is found by {world.python}: " in said
            assert "in a clone of tf2-ros-cython, pip install ./messages '.[ros]'" in said

    @pytest.mark.parametrize("module", LACKING)
    def test_a_module_for_nodes_says_so_when_it_is_imported(self, world, module):
        parent, _, name = module.rpartition(".")
        for code in (f"import {module}", f"from {parent} import {name}" if parent else f"import {module}"):
            assert " needs ROS 2, and no rclpy is found by " in world.lacks(code)


def test_what_is_about_recordings_loads(world):
    of_recordings = r"tf2_ros\.(numpy|records)|tf2_ros_tools(\.\w+)*"
    names = [name for name in modules() if re.fullmatch(of_recordings, name)]
    for of_nodes in ("listening", "relay", "screen", "state_publisher"):
        names.remove(f"tf2_ros_tools.{of_nodes}")
    assert "tf2_ros_tools.streams" in names and "tf2_ros_tools.programs.tf2_bag" in names
    world.does(f"""
import importlib, sys
for name in {names!r}:
    importlib.import_module(name)
assert not {{"rclpy", "geometry_msgs", "tf2_msgs"}} & {{*sys.modules}}
""")


class TestPrograms:
    @pytest.mark.parametrize("name", ["tf2_echo", "tf2_check", "view_frames"])
    def test_one_says_in_one_line_what_is_missing(self, world, name):
        arguments = ["map", "camera"] if name == "tf2_echo" else []
        ended = world.run("-m", f"tf2_ros_tools.programs.{name}", *arguments)
        assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (1, "", 1)
        assert ended.stderr.startswith(
            f"{name}: tf2_ros needs ROS 2, and no rclpy is found by {world.python}"
        )


class TestAnRclpyThatIsNoRos:
    """Where something is in its place, nobody asked for a buffer without ROS."""

    def test_one_that_does_not_load_is_an_error(self, world, tmp_path):
        (tmp_path / "rclpy").mkdir()
        (tmp_path / "rclpy" / "__init__.py").write_text("import librcl_that_is_missing\n")
        said = world.lacks(f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import tf2_ros")
        assert said == "ModuleNotFoundError: No module named 'librcl_that_is_missing'"

    def test_messages_alone_are_used_and_are_no_ros(self, world, tmp_path):
        for package in ("geometry_msgs", "builtin_interfaces", "std_msgs"):
            (tmp_path / package).mkdir()
            (tmp_path / package / "__init__.py").touch()
            classes = "Time Header Vector3 Point Quaternion Transform TransformStamped Pose PoseStamped"
            (tmp_path / package / "msg.py").write_text(
                "from tf2_py._objects import standins\n"
                + "".join(f"class {one}(standins.{one}): pass\n" for one in classes.split())
                + "class PointStamped: pass\nclass PoseWithCovarianceStamped: pass\n"
                + "class Vector3Stamped: pass\n"
            )
        said = world.does(f"""
import sys; sys.path.insert(0, {str(tmp_path)!r})
import tf2_ros, tf2_ros.numpy
from geometry_msgs.msg import Pose, TransformStamped
assert tf2_ros.TransformStamped is TransformStamped
import numpy
print(type(tf2_ros.numpy.from_matrix(numpy.eye(4), Pose)).__module__)
""")
        assert said == "geometry_msgs.msg\n"


def test_a_pickled_buffer_travels_between_a_ros_and_none(world, tf2_ros):
    mount = tf2_ros.TransformStamped(child_frame_id="camera")
    mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
    buffer = tf2_ros.Buffer()
    buffer.set_transform_static(mount, "example")
    said = world.does(f"""
import pickle
buffer = pickle.loads(bytes.fromhex({pickle.dumps(buffer).hex()!r}))
assert buffer.lookup_transform("base_link", "camera", 0).transform.translation.x == 0.3
print(pickle.dumps(buffer).hex())
""")
    back = pickle.loads(bytes.fromhex(said))
    assert type(back) is tf2_ros.Buffer
    assert back.lookup_transform("base_link", "camera", 0).transform == mount.transform
    assert back.can_transform("base_link", "camera", 0, timeout=0.01)


@pytest.mark.parametrize(
    "call",
    [
        "tf2_ros.Buffer(node=types.SimpleNamespace(create_service=print))",
        "tf2_ros.Buffer().wait_for_transform_async('a', 'b', 0)",
        "tf2_ros.Buffer().on_change('a', 'b', print)",
    ],
)
def test_what_a_buffer_lacks_needs_ros(world, call):
    assert " needs ROS 2, and no rclpy is found by " in world.lacks(f"import types, tf2_ros; {call}")


def test_a_buffer_works(world):
    """The tests of a buffer that need no ROS, in this environment."""
    path = ROOT / "tests" / "core" / "test_plain_buffer.py"
    ended = world.run("-m", "pytest", "-q", "-p", "no:cacheprovider", str(path))
    assert ended.returncode == 0, ended.stdout
    assert " passed" in ended.stdout and "skipped" not in ended.stdout


@pytest.mark.skipif(not program(RECORDINGS), reason="the page has no programs")
def test_the_chapter_about_recordings_holds(world, tmp_path):
    run_program(RECORDINGS, tmp_path, world.python, world.environment)
