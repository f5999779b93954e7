"""Message objects made and read by their slots, and what happens where that is not possible."""

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from geometry_msgs.msg import TransformStamped, Vector3
from making import at, transform
from rclpy.serialization import deserialize_message, serialize_message

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    buffer.set_transform(transform("map", "odom", 1.5, (1, 2, 3), (0.5, 0.5, 0.5, 0.5)), "x")
    return buffer


@pytest.fixture
def layout():
    from tf2_py._tf2_py import Layout

    return Layout


def test_the_slots_of_this_ros_are_used(layout):
    assert layout(Vector3, ("x", "y", "z")).by_slot
    assert layout(TransformStamped, ("header", "child_frame_id", "transform")).by_slot


def test_an_answer_is_a_message_like_any_other(buffer):
    m = buffer.lookup_transform_core("map", "odom", at(1.5))
    assert type(m) is TransformStamped
    assert m == transform("map", "odom", 1.5, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))
    assert repr(m) == repr(transform("map", "odom", 1.5, (1, 2, 3), (0.5, 0.5, 0.5, 0.5)))
    assert deserialize_message(serialize_message(m), TransformStamped) == m
    for part in (m, m.header, m.header.stamp, m.transform, m.transform.translation, m.transform.rotation):
        ordinary = type(part)()
        assert all(hasattr(part, slot) for slot in ordinary.__slots__)
        assert part._check_fields == ordinary._check_fields


def test_two_answers_share_nothing_that_can_change(buffer):
    a, b = (buffer.lookup_transform_core("map", "odom", at(1.5)) for _ in range(2))
    a.header.stamp.sec = 9
    a.transform.translation.x = 9.0
    assert b == transform("map", "odom", 1.5, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))


def test_a_message_with_a_deleted_field_is_a_type_error(buffer):
    m = transform("map", "odom", 2)
    del m.transform.translation._x
    with pytest.raises(TypeError, match="_x"):
        buffer.set_transform(m, "x")


class Subclass(Vector3):
    """A message class of a program's own."""


class WithExtraSlot:
    __slots__ = ("x", "y", "z", "extra")

    def __init__(self):
        self.x = self.y = self.z = 0.0
        self.extra = []


class WithDict:
    def __init__(self):
        self.x = self.y = self.z = 0.0


class WithProperties:
    __slots__ = ("_x", "_y", "_z")

    def __init__(self):
        self._x = self._y = self._z = 0.0

    x = property(lambda self: self._x + 1.0)
    y = property(lambda self: self._y)
    z = property(lambda self: self._z)


class WithNew:
    __slots__ = ("x", "y", "z")

    def __new__(cls):
        made = super().__new__(cls)
        made.x = made.y = made.z = 0.0
        return made


@pytest.mark.parametrize("cls", [Subclass, WithExtraSlot, WithDict, WithProperties, WithNew])
def test_classes_that_look_otherwise_go_through_their_attributes(layout, cls):
    assert not layout(cls, ("x", "y", "z")).by_slot


def test_subclasses_of_the_message_classes_are_read(buffer):
    m = transform("map", "odom", 2)
    m.transform.translation = Subclass(x=7.0)
    buffer.set_transform(m, "x")
    assert buffer.lookup_transform_core("map", "odom", at(2)).transform.translation.x == 7.0


def test_the_engine_works_where_ros_is_not_installed(tf2_py, tmp_path):
    installed = Path(tf2_py.__file__).parent.parent
    for package in ("tf2_py", "tf2_ros_cython"):
        (tmp_path / package).symlink_to(installed / package)
    program = """
        import sys
        sys.path.insert(0, sys.argv[1])
        from types import SimpleNamespace as N
        import tf2_py
        q = N(x=0.0, y=0.0, z=0.0, w=1.0)
        m = N(
            header=N(stamp=N(sec=1, nanosec=5), frame_id="map"), child_frame_id="odom",
            transform=N(translation=N(x=1.0, y=2.0, z=3.0), rotation=q),
        )
        buffer = tf2_py.BufferCore(N(nanoseconds=10**9))
        buffer.set_transform(m, "x")
        buffer.set_transform(N(**(vars(m) | {"child_frame_id": "map"})), "x")   # refused: goes to logging
        answer = buffer.lookup_transform_core("map", "odom", N(sec=0, nanosec=0))
        print(answer.header.stamp.sec, answer.header.stamp.nanosec, answer.header.frame_id)
        print(answer.transform.translation.z, answer.transform.rotation.w)
        print(buffer.get_latest_common_time("map", "odom").nanoseconds)
        buffer.set_transform(answer, "x")
        print("rclpy" in sys.modules, "geometry_msgs" in sys.modules)
    """
    # -S: without site-packages there is no ROS on the path.
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", textwrap.dedent(program), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n") == ["1 5 map", "3.0 1.0", "1000000005", "False False", ""]
    assert "TF_SELF_TRANSFORM" in done.stderr


def test_importing_the_engine_imports_no_message_package():
    code = "import sys, tf2_py; print(*(m for m in ('rclpy', 'geometry_msgs', 'numpy') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "\n"), done.stderr
