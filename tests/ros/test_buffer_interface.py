# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transforming objects through a buffer, and the tables of functions for that."""

import textwrap

import pytest
from geometry_msgs.msg import (
    Inertia,
    InertiaStamped,
    PointStamped,
    PoseStamped,
    QuaternionStamped,
    Twist,
    Vector3Stamped,
    Wrench,
)
from processes import output_of
from rclpy.duration import Duration
from rclpy.time import Time
from sensor_msgs.msg import JointState, LaserScan, PointCloud2, Range
from std_msgs.msg import Header, String
from times_and_transforms import at, transform
from visualization_msgs.msg import Marker
from waiting import until

SHORT = Duration(seconds=0.01)


class Thing:
    """What a program may want transformed: counts how far it went."""

    def __init__(self, x, frame_id="robot", time=None):
        self.x = x
        self.header = Header(frame_id=frame_id, stamp=(time or Time()).to_msg())


class OtherThing:
    def __init__(self, x):
        self.x = x


def move(thing, t):
    return Thing(thing.x + t.transform.translation.x, t.header.frame_id)


@pytest.fixture
def buffer(tf2_ros):
    buffer = tf2_ros.Buffer()
    for seconds in (1, 2):
        buffer.set_transform(transform("map", "robot", seconds, (seconds, 0, 0)), "me")
    tf2_ros.TransformRegistration().add(Thing, move)
    return buffer


@pytest.fixture
def interface(tf2_ros):
    """The module whose names the tests use."""
    return tf2_ros.buffer_interface


class TestTransform:
    @pytest.mark.tf2
    def test_an_object_is_carried_at_its_own_time(self, buffer):
        carried = buffer.transform(Thing(10, time=at(1.5)), "map")
        assert (carried.x, carried.header.frame_id) == (11.5, "map")

    def test_the_result_becomes_the_type_asked_for(self, buffer, interface, executor):
        interface.ConvertRegistration().add_convert((Thing, OtherThing), lambda thing: OtherThing(thing.x))
        thing = Thing(10, time=at(2))
        task = executor.create_task(buffer.transform_async(thing, "map", new_type=OtherThing))
        until(task.done, executor)
        for got in (
            buffer.transform(thing, "map", new_type=OtherThing),
            buffer.transform_full(thing, "map", at(1), "map", new_type=OtherThing),
            task.result(),
        ):
            assert (type(got), got.x) == (OtherThing, 12)
        del thing.header
        calls = (
            lambda: buffer.transform(thing, "map"),
            lambda: buffer.transform_full(thing, "map", at(1), "map"),
            lambda: buffer.transform_async(thing, "map").send(None),
        )
        for call in calls:
            with pytest.raises(interface.TypeException, match="header") as caught:
                call()
            assert isinstance(caught.value, (AttributeError, TypeError))
            assert caught.value.errstr == str(caught.value)

    def test_the_timeout_reaches_the_lookup(self, buffer, executor, tf2_py):
        thing = Thing(10, time=at(3))
        with pytest.raises(tf2_py.ExtrapolationException):
            buffer.transform(thing, "map", SHORT)
        with pytest.raises(tf2_py.ExtrapolationException):
            buffer.transform_full(thing, "map", at(1), "map", SHORT)
        task = executor.create_task(buffer.transform_async(thing, "map", SHORT))
        with pytest.raises(tf2_py.TimeoutException):
            until(
                task.done, executor
            )  # in some releases, a task that was resumed raises only in the next line
            task.result()

    def test_an_interface_with_lookups_can_say_whether_they_answer(self, interface, tf2_py):
        class Growing(interface.BufferInterface):
            def lookup_transform(self, target_frame, source_frame, time, timeout=None):
                if target_frame != "map":
                    raise tf2_py.LookupException("unknown")

        grown = Growing()
        assert grown.can_transform("map", "robot", Time())
        assert grown.can_transform("moon", "robot", Time(), return_debug_tuple=True) == (False, "unknown")


class Unknown:
    """A type that nobody registers."""


@pytest.mark.parametrize(
    ("message", "new_type", "cure"),
    [
        (JointState(), None, r"JointState'> is not .*TransformRegistration\(\)\.add"),
        (InertiaStamped(), None, r"InertiaStamped'> is not .*TransformRegistration\(\)\.add"),
        (Unknown(), None, r"Unknown'> is not .*TransformRegistration\(\)\.add"),
        (PointStamped(), Unknown, r"Unknown'> is not .*ConvertRegistration\(\)\.add_from_msg"),
    ],
)
def test_an_unknown_type_is_refused_by_name_and_with_a_cure(buffer, interface, message, new_type, cure):
    message.header = Header(frame_id="robot")
    with pytest.raises(interface.TypeException, match=cure):
        buffer.transform(message, "map", new_type=new_type)


def test_the_refusal_of_a_type_says_what_would_help(buffer, interface):
    with pytest.raises(interface.TypeException) as caught:
        buffer.transform(Unknown(), "map")
    said = f"Type {Unknown} is not loaded or supported"  # as tf2
    assert str(caught.value).startswith(f"{said}: import the package that registers it, or register")
    assert caught.value.errstr == str(caught.value)
    with pytest.raises(interface.TypeException, match="supported: pass the message first, then the frame"):
        buffer.transform("map", PoseStamped())
    with pytest.raises(interface.TypeException, match="supported: put it into TwistStamped, see the page"):
        buffer.transform(Twist(), "map")
    # InertiaStamped is no answer: it cannot be transformed, either.
    with pytest.raises(interface.TypeException, match='supported: see the page "Message types" of the doc'):
        buffer.transform(Inertia(), "map")


@pytest.mark.parametrize("nobodys", [String(), Header(), Marker(), 5, {}, (1.0, 2.0), b"map"], ids=repr)
def test_no_package_is_named_for_a_type_that_none_registers(buffer, interface, nobodys):
    with pytest.raises(interface.TypeException, match="supported: register a function with tf2_ros"):
        buffer.transform(nobodys, "map")


def test_a_package_that_tf2_would_have_for_messages_is_named_if_it_is_installed(
    buffer, interface, tmp_path, monkeypatch
):
    (tmp_path / "tf2_visualization_msgs.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(interface.TypeException, match="import tf2_visualization_msgs, which may register it"):
        buffer.transform(Marker(), "map")


@pytest.mark.parametrize(
    ("kind", "title", "section"),
    [(LaserScan, "Point clouds and scans", "Laser scans"), (Range, "Message types", None)],
    ids=str,
)
def test_the_refusal_of_a_type_whose_package_is_imported_names_the_page(
    buffer, interface, kind, title, section
):
    where = f'"{section}" on the page "{title}"' if section else f'the page "{title}"'
    text = f"supported: see {where} of the documentation, or register a function"
    with pytest.raises(interface.TypeException, match=text):
        buffer.transform(kind(), "map")


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_registration_of_a_programs_own_wins(when):
    mine = "tf2_ros.TransformRegistration().add(PointStamped, lambda point, transform: 'mine')"
    steps = [mine, "import tf2_geometry_msgs"]
    program = [
        "import tf2_ros",
        "from geometry_msgs.msg import PointStamped",
        *(steps if when == "before" else reversed(steps)),
        "print(tf2_ros.TransformRegistration().get(PointStamped)(None, None))",
    ]
    # In a process of its own: what is registered, stays.
    assert output_of("-c", "\n".join(program)) == "mine\n"


@pytest.mark.parametrize(
    ("package", "name", "provider"),
    [
        ("geometry_msgs", "PointStamped", "tf2_geometry_msgs"),
        ("nav_msgs", "Path", "tf2_geometry_msgs"),
        ("sensor_msgs", "Imu", "tf2_sensor_msgs"),
    ],
)
def test_importing_tf2_ros_alone_is_enough(package, name, provider):
    program = f"""
        import sys, tf2_ros
        from {package}.msg import {name}
        from geometry_msgs.msg import TransformStamped
        buffer = tf2_ros.Buffer()
        buffer.set_transform_static(
            TransformStamped(header=tf2_ros.Header(frame_id="map"), child_frame_id="base"), "x"
        )
        print("{provider}" in sys.modules)
        print(buffer.transform({name}(header=tf2_ros.Header(frame_id="base")), "map").header.frame_id)
        print("{provider}" in sys.modules)
    """
    assert output_of("-c", textwrap.dedent(program)).split() == ["False", "map", "True"]


@pytest.mark.tf2
def test_registrations_can_be_printed(buffer, interface, capsys):
    interface.TransformRegistration().print_me()
    assert "Thing" in capsys.readouterr().out


class TestConvert:
    @pytest.mark.tf2
    def test_the_same_type_is_copied(self, interface, capsys):
        pose = PoseStamped()
        copied = interface.convert(pose, PoseStamped)
        assert copied == pose
        assert copied is not pose
        assert copied.pose.position is not pose.pose.position
        assert type(interface.convert(QuaternionStamped(), QuaternionStamped)) is QuaternionStamped
        assert capsys.readouterr().out == ""

    @pytest.mark.tf2
    def test_the_straight_way_wins(self, interface):
        class A:
            pass

        table = interface.ConvertRegistration()
        table.add_to_msg(A, lambda a: "message")
        table.add_from_msg(OtherThing, lambda message: "through a message")
        assert interface.convert(A(), OtherThing) == "through a message"
        table.add_convert((A, OtherThing), lambda a: "straight")
        assert interface.convert(A(), OtherThing) == "straight"

    @pytest.mark.parametrize("wanted", [PoseStamped, Vector3Stamped, Wrench, PointCloud2])
    def test_a_message_never_passes_for_one_of_another_type(self, buffer, interface, wanted):
        point = interface.Stamped(PointStamped(), at(1), "map")
        for call in (
            lambda: interface.convert(point, wanted),
            lambda: buffer.transform(point, "map", new_type=wanted),
            lambda: buffer.transform_full(point, "map", at(1), "map", new_type=wanted),
        ):
            with pytest.raises(interface.TypeException, match="PointStamped cannot be converted to"):
                call()


@pytest.mark.parametrize("stamp", [at(1.5), at(1.5).to_msg()], ids=["rclpy", "message"])
def test_stamped_gives_an_object_a_header(interface, stamp):
    cloud = PointCloud2()
    assert interface.Stamped(cloud, stamp, "map") is cloud
    assert (cloud.header.frame_id, cloud.header.stamp) == ("map", at(1.5).to_msg())
