"""Transforming objects through a buffer, and the tables of functions for that."""

import subprocess
import sys

import pytest
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    QuaternionStamped,
    Vector3Stamped,
    Wrench,
)
from making import at, transform
from processes import until
from rclpy.duration import Duration
from rclpy.time import Time
from sensor_msgs.msg import LaserScan, PointCloud2, Range
from std_msgs.msg import Header


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
    def test_an_object_is_carried_at_its_own_time(self, buffer):
        carried = buffer.transform(Thing(10, time=at(1.5)), "map")
        assert (carried.x, carried.header.frame_id) == (11.5, "map")

    def test_full_carries_it_from_time_to_time(self, buffer):
        carried = buffer.transform_full(Thing(10, time=at(1)), "robot", at(2), "map")
        assert (carried.x, carried.header.frame_id) == (9, "robot")

    def test_the_timeout_reaches_the_lookup(self, buffer, tf2_py):
        with pytest.raises(tf2_py.ExtrapolationException):
            buffer.transform(Thing(10, time=at(3)), "map", Duration(seconds=0.01))
        with pytest.raises(tf2_py.ExtrapolationException):
            buffer.transform_full(Thing(10, time=at(3)), "map", at(1), "map", Duration(seconds=0.01))

    def test_the_result_may_be_converted(self, buffer, interface):
        interface.ConvertRegistration().add_convert((Thing, OtherThing), lambda thing: OtherThing(thing.x))
        assert type(buffer.transform(Thing(1), "map", new_type=OtherThing)) is OtherThing
        carried = buffer.transform_full(Thing(1, time=at(1)), "map", at(1), "map", new_type=OtherThing)
        assert (type(carried), carried.x) == (OtherThing, 2)

    @pytest.mark.ours
    def test_an_object_may_be_awaited(self, buffer, executor, tf2_py):
        task = executor.create_task(buffer.transform_async(Thing(10, time=at(3)), "map", new_type=Thing))
        executor.spin_once(timeout_sec=0)
        assert not task.done()
        buffer.set_transform(transform("map", "robot", 3, (3, 0, 0)), "me")
        until(task.done, executor)
        assert task.result().x == 13

    @pytest.mark.ours
    def test_awaiting_an_object_has_a_timeout(self, buffer, executor, tf2_py):
        coroutine = buffer.transform_async(Thing(10, time=at(3)), "map", Duration(seconds=0.01))
        task = executor.create_task(coroutine)
        with pytest.raises(tf2_py.TimeoutException):  # rclpy raises it out of spinning
            until(task.done, executor)

    def test_an_unknown_type_is_refused(self, buffer, interface):
        class Unknown(Thing):
            pass

        with pytest.raises(interface.TypeException, match="Unknown.*is not loaded or supported") as caught:
            buffer.transform(Unknown(1), "map")
        assert "is not loaded or supported" in caught.value.errstr

    @pytest.mark.ours
    def test_the_refusal_says_what_would_help(self, buffer, interface):
        with pytest.raises(interface.TypeException, match=r"builtins\.int .*TransformRegistration\(\)\.add"):
            buffer.registration.get(int)
        with pytest.raises(interface.TypeException, match=r"geometry_msgs\.msg\.Nothing is not"):
            buffer.registration.get(type("Nothing", (), {"__module__": "geometry_msgs.msg._nothing"}))

    @pytest.mark.ours
    def test_the_refusal_of_a_message_lists_the_known_ones_of_its_package(self, buffer, interface):
        with pytest.raises(interface.TypeException) as caught:
            buffer.transform(Range(), "map")
        assert "tf2_sensor_msgs knows Imu, MagneticField, PointCloud2 of sensor_msgs" in str(caught.value)

    @pytest.mark.ours
    def test_the_refusal_of_a_scan_says_to_convert_it_to_points(self, buffer, interface):
        with pytest.raises(interface.TypeException, match=r"LaserScan .* convert it to points"):
            buffer.transform(LaserScan(), "map")

    @pytest.mark.ours
    def test_an_object_without_a_header_is_told_what_it_lacks(self, buffer):
        with pytest.raises(AttributeError, match="Thing has no attribute 'header': .* frame_id and stamp"):
            thing = Thing(1)
            del thing.header
            buffer.transform(thing, "map")

    @pytest.mark.ours
    def test_an_error_about_an_object_without_a_frame_says_so_at_its_end(self, buffer, executor, tf2_py):
        text = (
            r"argument source_frame - in tf2 .* cannot be empty\. The header\.frame_id of the Thing is empty$"
        )
        nowhere = Thing(1, frame_id="")
        task = executor.create_task(buffer.transform_async(nowhere, "map"))
        for call in (
            lambda: buffer.transform(nowhere, "map"),
            lambda: buffer.transform_full(nowhere, "map", Time(), "map"),
            lambda: until(task.done, executor),
        ):
            with pytest.raises(tf2_py.InvalidArgumentException, match=text):
                call()

    def test_an_interface_without_lookups_says_so(self, interface):
        bare = interface.BufferInterface()
        for call in (
            lambda: bare.lookup_transform("a", "b", Time()),
            lambda: bare.lookup_transform_full("a", Time(), "b", Time(), "c"),
            lambda: bare.can_transform("a", "b", Time()),
            lambda: bare.can_transform_full("a", Time(), "b", Time(), "c"),
        ):
            with pytest.raises(interface.NotImplementedException) as caught:
                call()
            assert "not implemented" in caught.value.errstr


@pytest.mark.ours
class TestKnownTypes:
    """Each in a process of its own: what is registered, stays."""

    def run(self, program):
        finished = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert finished.returncode == 0, finished.stderr
        return finished.stdout

    BEGIN = """
import sys
import tf2_ros
from geometry_msgs.msg import PointStamped, TransformStamped
buffer = tf2_ros.Buffer()
t = TransformStamped()
t.header.frame_id, t.child_frame_id, t.transform.translation.x = "map", "robot", 1.0
buffer.set_transform_static(t, "me")
point = PointStamped()
point.header.frame_id = "robot"
assert "tf2_geometry_msgs" not in sys.modules
"""

    @pytest.mark.parametrize("when", ["before", "after"])
    def test_a_registration_of_ones_own_wins(self, when):
        mine = "tf2_ros.TransformRegistration().add(PointStamped, lambda point, transform: 'mine')\n"
        program = [mine, "import tf2_geometry_msgs\n"]
        if when == "after":
            program.reverse()
        assert self.run(self.BEGIN + "".join(program) + "print(buffer.transform(point, 'map'))") == "mine\n"


class TestRegistration:
    def test_the_last_one_counts(self, interface):
        registration = interface.TransformRegistration()
        registration.add(OtherThing, len)
        registration.add(OtherThing, move)
        assert interface.TransformRegistration().get(OtherThing) is move

    @pytest.mark.ours
    @pytest.mark.parametrize(
        ("key", "callback", "said"),
        [
            (Thing(1), move, "needs a type as key, not <"),
            (move, Thing, "needs a type as key, not <function move"),
            (Thing, None, "TransformRegistration.add needs a function to call, not NoneType"),
        ],
    )
    def test_what_no_transform_could_use_is_refused(self, interface, key, callback, said):
        with pytest.raises(TypeError, match=said):
            interface.TransformRegistration().add(key, callback)

    def test_the_table_can_be_printed(self, buffer, interface, capsys):
        interface.TransformRegistration().print_me()
        assert "Thing" in capsys.readouterr().out


class TestConvert:
    @pytest.fixture
    def table(self, interface):
        return interface.ConvertRegistration()

    def test_the_same_type_is_copied(self, interface):
        pose = PoseStamped()
        copied = interface.convert(pose, PoseStamped)
        assert copied == pose
        assert copied is not pose
        assert copied.pose.position is not pose.pose.position

    def test_the_straight_way_wins(self, interface, table):
        class A:
            pass

        table.add_to_msg(A, lambda a: "message")
        table.add_from_msg(OtherThing, lambda message: "through a message")
        assert interface.convert(A(), OtherThing) == "through a message"
        table.add_convert((A, OtherThing), lambda a: "straight")
        assert interface.convert(A(), OtherThing) == "straight"

    def test_what_was_added_can_be_got(self, table):
        table.add_to_msg(Thing, len)
        table.add_from_msg(Thing, repr)
        table.add_convert((Thing, int), hash)
        assert table.get_to_msg(Thing) is len
        assert table.get_from_msg(Thing) is repr
        assert table.get_convert((Thing, int)) is hash

    def test_no_way_is_an_error(self, interface, table):
        for call in (
            lambda: interface.convert(1, Wrench),
            lambda: table.get_to_msg(int),
            lambda: table.get_from_msg(int),
            lambda: table.get_convert((int, str)),
        ):
            with pytest.raises(interface.TypeException, match="is not loaded or supported"):
                call()

    def test_types_that_are_not_registered_are_not_converted(self, interface):
        for a, wanted in (
            (PoseWithCovarianceStamped(), PoseStamped),
            (PointStamped(), PoseWithCovarianceStamped),
        ):
            with pytest.raises(interface.TypeException):
                interface.convert(a, wanted)

    @pytest.mark.ours
    @pytest.mark.parametrize("wanted", [PoseStamped, Vector3Stamped, Wrench, PointCloud2])
    def test_a_message_never_passes_for_one_of_another_type(self, buffer, interface, wanted):
        point = interface.Stamped(PointStamped(), at(1), "map")
        with pytest.raises(interface.TypeException, match="PointStamped cannot be converted to"):
            interface.convert(point, wanted)
        with pytest.raises(interface.TypeException, match="PointStamped cannot be converted to"):
            buffer.transform(point, "map", new_type=wanted)
        with pytest.raises(interface.TypeException, match="PointStamped cannot be converted to"):
            buffer.transform_full(point, "map", at(1), "map", new_type=wanted)

    def test_a_message_is_converted_from_and_to_a_type_of_ones_own(self, interface, table):
        class Spot:
            def __init__(self, x):
                self.x = x

        class Point(PointStamped):
            pass

        table.add_from_msg(Spot, lambda message: Spot(message.point.x))
        table.add_to_msg(Spot, lambda spot: PointStamped())
        assert interface.convert(PointStamped(), Spot).x == 0.0
        assert type(interface.convert(Spot(1), PointStamped)) is PointStamped
        table.add_to_msg(Spot, lambda spot: Point())
        assert type(interface.convert(Spot(1), PointStamped)) is Point

    @pytest.mark.ours
    def test_nothing_is_printed(self, interface, capsys):
        interface.convert(QuaternionStamped(), QuaternionStamped)
        assert capsys.readouterr().out == ""


class TestStamped:
    def test_it_gives_an_object_a_header(self, interface):
        point = interface.Stamped(PointStamped(), at(1.5).to_msg(), "map")
        assert (point.header.frame_id, point.header.stamp) == ("map", at(1.5).to_msg())

    @pytest.mark.ours
    def test_the_stamp_may_be_an_rclpy_time(self, interface):
        cloud = PointCloud2()
        assert interface.Stamped(cloud, at(1.5), "map") is cloud
        assert cloud.header.stamp == at(1.5).to_msg()
