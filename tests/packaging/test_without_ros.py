# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An environment without ROS: buffers need no more."""

import pickle

import pytest
from documentation_pages import program
from environment_without_ros import make_world
from paths import ROOT
from project_sources import PYPROJECT

pytestmark = pytest.mark.long("makes an environment without ROS 2")

NODES = ("buffer_client", "buffer_server", "message_filter", "static_transform_broadcaster")
NODES += ("static_transform_listener", "transform_broadcaster", "transform_listener")
NEED_ROS = [
    *(
        f"import tf2_ros; tf2_ros.{name}"
        for name in ("BufferClient", "MessageFilter", "Time", "TransformListener")
    ),
    *(f"import tf2_ros.{module}" for module in NODES),
    *(f"from tf2_ros import {module}" for module in NODES),
    "import tf2_geometry_msgs",
    "import tf2_sensor_msgs",
    "import types, tf2_ros; tf2_ros.Buffer(node=types.SimpleNamespace(create_service=print))",
]


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    project = PYPROJECT["project"]
    wanted = ["pytest", "hypothesis", *project["dependencies"]]
    return make_world(tmp_path_factory.mktemp("without_ros"), wanted)


@pytest.mark.parametrize("code", NEED_ROS)
def test_what_needs_ros_says_so_and_what_to_install(world, code):
    said = world.lacks(code)
    assert f" needs ROS 2, but {world.python} finds no rclpy: " in said
    assert "in a clone of tf2-ros-cython: pip install ./messages '.[ros]'" in said


def test_what_needs_no_ros_loads(world):
    world.does("""
import sys
import tf2_ros.numpy, tf2_ros.records, tf2_ros.serialization
assert not {"rclpy", "geometry_msgs", "tf2_msgs"} & {*sys.modules}
""")


def test_a_message_that_cannot_be_transformed_here_is_told_what_can(world):
    said = world.lacks("import tf2_ros; tf2_ros.Buffer().transform(tf2_ros.PoseStamped(), 'map')")
    assert ": without ROS 2, use to_matrix of tf2_ros.numpy, or buffer.transform_points, or register" in said


def test_the_program_of_the_page_works(world):
    assert world.does(program(ROOT / "docs" / "installing.md")) == "0.3\n"


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
                "from tf2_py._objects import message_standins\n"
                + "".join(f"class {one}(message_standins.{one}): pass\n" for one in classes.split())
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


@pytest.mark.parametrize("name", ["buffer", "waits", "sources", "clocks"])
def test_a_buffer_works(world, name):
    """The tests of a buffer that need no ROS, in this environment."""
    path = ROOT / "tests" / "core" / f"test_{name}_without_node.py"
    ended = world.run("-m", "pytest", "-q", "-p", "no:cacheprovider", str(path))
    assert ended.returncode == 0, ended.stdout
    assert " passed" in ended.stdout and "skipped" not in ended.stdout
