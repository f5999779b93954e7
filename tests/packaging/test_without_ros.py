"""An environment without ROS, with the extensions of this checkout: buffers and recordings need no more."""

import json
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
from public_names import MODULES, NAMES, OURS
from sources import PYPROJECT, modules

pytestmark = [pytest.mark.ours, pytest.mark.long("makes an environment without ROS 2")]

RECORDINGS = ROOT / "docs" / "recordings.md"
EXTRAS = ("bag", "fleet", "rerun", "scipy", "cli", "plot")
# What tf2's modules offer that is of ROS, and this project's names that are about nodes.
WITHOUT = {
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "ActionClient",
    "BufferClient",
    "BufferServer",
    "Clock",
    "DurabilityPolicy",
    "Duration",
    "FilterFailureReason",
    "FrameGraph",
    "Future",
    "HistoryPolicy",
    "JumpThreshold",
    "LookupTransform",
    "LookupTransformGoal",
    "LookupTransformResult",
    "MessageFilter",
    "MsgStamped",
    "Node",
    "PointCloud2",
    "PointStamped",
    "PoseWithCovarianceStamped",
    "QoSProfile",
    "ReentrantCallbackGroup",
    "SingleThreadedExecutor",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "TFMessage",
    "Time",
    "TimeJump",
    "TransformBroadcaster",
    "TransformListener",
    "TransformableObject",
    "Vector3Stamped",
    "buffer_client",
    "builtin_interfaces",
    "rclpy",
    "static_transform_broadcaster",
    "transform_broadcaster",
    "transform_listener",
}
WORKING = ("tf2_py", "tf2_ros", "tf2_ros.buffer", "tf2_ros.buffer_interface", "tf2_ros.numpy")
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


def test_there_is_no_ros(world):
    for package in ("rclpy", "geometry_msgs", "builtin_interfaces", "tf2_msgs"):
        assert world.lacks(f"import {package}").startswith("ModuleNotFoundError: No module named")


def test_advice_names_nothing_of_ros(world):
    said = world.lacks("import tf2_ros; tf2_ros.Buffer().can_transform('map', 'base', 1.5)")
    assert said == (
        "TypeError: time: expected nanoseconds, or sec and nanosec, got float: use an int of"
        " nanoseconds, as round(seconds * 1e9), a datetime64, or 0 for the latest"
    )


class TestNames:
    @pytest.mark.parametrize("module", WORKING)
    def test_each_works_or_says_what_to_install(self, world, module):
        names = {*NAMES.get(module, {"names": {}})["names"], *OURS.get(module, ()), *MODULES.get(module, ())}
        said = json.loads(
            world.does(f"""
import importlib, json
module, said = importlib.import_module({module!r}), {{}}
for name in {sorted(names)!r}:
    try:
        said[name] = getattr(module, name) is None
    except ModuleNotFoundError as error:
        said[name] = [error.name, str(error)]
print(json.dumps(said))
""")
        )
        assert {name for name in names if said[name] is not False} == names & WITHOUT
        for name in names & WITHOUT:
            missing, text = said[name]
            assert missing == "rclpy"
            assert text.startswith(f"{module}.{name} needs ROS 2, and no rclpy is found by {world.python}: ")
            assert "in a clone of tf2-ros-cython, pip install ./messages '.[ros]'" in text

    @pytest.mark.parametrize("module", LACKING)
    def test_a_module_for_nodes_says_so_when_it_is_imported(self, world, module):
        parent, _, name = module.rpartition(".")
        for code in (f"import {module}", f"from {parent} import {name}" if parent else f"import {module}"):
            assert " needs ROS 2, and no rclpy is found by " in world.lacks(code)

    def test_import_star_gives_those_that_work(self, world):
        given = world.does("from tf2_ros import *; print(*[name for name in dir() if name[0] != '_'])")
        assert set(given.split()) == set(NAMES["tf2_ros"]["import *"]) - WITHOUT
        for module in ("tf2_ros.buffer", "tf2_ros.buffer_interface"):
            world.does(f"from {module} import *")

    def test_what_never_was_is_an_attribute_error(self, world):
        for module in ("tf2_ros", "tf2_ros.buffer"):
            said = world.lacks(f"import {module} as module; module.nothing")
            assert said == f"AttributeError: module {module!r} has no attribute 'nothing'"
            assert world.lacks(f"from {module} import nothing").startswith("ImportError: cannot import name")

    def test_they_are_the_same_after_a_reload(self, world):
        world.does("""
import importlib, tf2_ros
before = dict(vars(tf2_ros))
importlib.reload(tf2_ros)
assert tf2_ros.Buffer is before["Buffer"] and tf2_ros.__all__ == before["__all__"]
try:
    tf2_ros.TransformListener
except ModuleNotFoundError:
    pass
else:
    raise AssertionError
""")

    def test_threads_may_import_it_at_the_same_time(self, world):
        world.does("""
import threading
begin, failed = threading.Barrier(8), []
def import_it(number):
    begin.wait()
    try:
        if number % 2:
            from tf2_ros import Buffer
        else:
            import tf2_ros.numpy
    except BaseException as error:
        failed.append(error)
threads = [threading.Thread(target=import_it, args=(number,)) for number in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert failed == [], failed
""")

    def test_a_pickle_names_the_buffer_as_with_ros(self, world, tf2_ros):
        said = world.does("import pickle, tf2_ros; print(pickle.dumps(tf2_ros.Buffer, 0).hex())")
        assert pickle.loads(bytes.fromhex(said)) is tf2_ros.Buffer
        assert tf2_ros.buffer.Buffer is tf2_ros.Buffer


def test_what_is_about_recordings_loads(world):
    of_recordings = r"tf2_ros\.(numpy|records)|tf2_ros_tools(\.\w+)*"
    names = [name for name in modules() if re.fullmatch(of_recordings, name)]
    for of_nodes in ("listening", "relaying", "screen", "state_publisher"):
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

    def test_one_shows_its_help(self, world):
        ended = world.run("-m", "tf2_ros_tools.programs.tf2_echo", "--help")
        assert ended.returncode == 0
        assert ended.stdout.startswith("usage: tf2_echo")


class TestAnRclpyThatIsNoRos:
    """Where something is in its place, nobody asked for a buffer without ROS."""

    def test_one_that_does_not_load_is_an_error(self, world, tmp_path):
        (tmp_path / "rclpy").mkdir()
        (tmp_path / "rclpy" / "__init__.py").write_text("import librcl_that_is_missing\n")
        said = world.lacks(f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import tf2_ros")
        assert said == "ModuleNotFoundError: No module named 'librcl_that_is_missing'"

    def test_a_programs_own_module_is_taken_as_it_is(self, world):
        said = world.lacks(
            "import sys, types; sys.modules['rclpy'] = types.ModuleType('rclpy'); import tf2_ros"
        )
        assert said.startswith("ModuleNotFoundError: No module named 'rclpy.")

    def test_a_program_may_say_that_there_is_none(self, world):
        world.does("import sys; sys.modules['rclpy'] = None; import tf2_ros; tf2_ros.Buffer()")

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


class TestWhatABufferLacks:
    NEEDS = "ModuleNotFoundError: {} needs ROS 2, and no rclpy is found by "

    def test_it_has_no_node(self, world):
        code = "import types, tf2_ros; tf2_ros.Buffer(node=types.SimpleNamespace(create_service=print))"
        assert world.lacks(code).startswith(self.NEEDS.format("a buffer with a node"))

    def test_it_has_no_futures(self, world):
        for call in (
            "wait_for_transform_async('a', 'b', 0)",
            "wait_for_transform_full_async('a', 0, 'b', 0, 'c')",
        ):
            said = world.lacks(f"import tf2_ros; tf2_ros.Buffer().{call}")
            assert said.startswith(self.NEEDS.format("a future of a transform"))
        awaiting = (
            "import asyncio, tf2_ros; asyncio.run(tf2_ros.Buffer().lookup_transform_async('a', 'b', 0))"
        )
        assert world.lacks(awaiting).startswith(self.NEEDS.format("a future of a transform"))
        following = "import tf2_ros; tf2_ros.Buffer().on_change('a', 'b', print)"
        assert world.lacks(following).startswith(self.NEEDS.format("waiting for changes of a transform"))

    def test_no_clock_clears_it(self, world):
        ended = world.run("-c", "import tf2_ros; tf2_ros.Buffer().time_jump_callback(None)")
        assert (ended.returncode, ended.stderr) == (0, "Detected jump back in time. Clearing TF buffer.\n")
        said = world.lacks("import tf2_ros; tf2_ros.Buffer().time_jump_callback(5)")
        assert said.startswith(self.NEEDS.format("a clock that jumps"))


def test_a_buffer_works(world):
    """The tests of a buffer that need no ROS, in this environment."""
    path = ROOT / "tests" / "core" / "test_plain_buffer.py"
    ended = world.run("-m", "pytest", "-q", "-p", "no:cacheprovider", str(path))
    assert ended.returncode == 0, ended.stdout
    assert " passed" in ended.stdout and "skipped" not in ended.stdout


@pytest.mark.skipif(not program(RECORDINGS), reason="the page has no programs")
def test_the_chapter_about_recordings_holds(world, tmp_path):
    run_program(RECORDINGS, tmp_path, world.python, world.environment)
