"""What raises for objects that lack what their role needs: the exceptions that programs of tf2 catch."""

from types import SimpleNamespace

import pytest
from geometry_msgs.msg import (
    PointStamped,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from making import at, transform
from rclpy.time import Time

import tf2_geometry_msgs

FUNCTIONS = {
    "do_transform_point": PointStamped,
    "do_transform_polygon_stamped": PolygonStamped,
    "do_transform_pose": Pose,
    "do_transform_pose_stamped": PoseStamped,
    "do_transform_pose_with_covariance_stamped": PoseWithCovarianceStamped,
    "do_transform_vector3": Vector3Stamped,
}
every_function = pytest.mark.parametrize("name", FUNCTIONS)


@pytest.fixture
def t():
    return transform("map", "base", 1, (1, 2, 3))


@pytest.fixture
def buffer(tf2_ros, t):
    buffer = tf2_ros.Buffer()
    buffer.set_transform_static(t, "x")
    return buffer


@every_function
def test_other_objects_and_transforms_are_attribute_errors(name, t):
    function, message = getattr(tf2_geometry_msgs, name), FUNCTIONS[name]()
    headless = [SimpleNamespace(transform=t.transform), t.transform] if name != "do_transform_pose" else []
    no_rotation = SimpleNamespace(transform=SimpleNamespace(translation=Vector3()))
    for arguments in (
        *[(wrong, t) for wrong in (None, 5, "text", SimpleNamespace(header=1), Quaternion())],
        *[(message, wrong) for wrong in (None, 5, Pose(), SimpleNamespace(), no_rotation, *headless)],
    ):
        with pytest.raises(AttributeError):
            function(*arguments)


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name != "do_transform_polygon_stamped"])
def test_a_rotation_that_is_no_number_is_a_value_error(name):
    # Not for an empty polygon, which asks for no rotation. NumPy's LinAlgError is a ValueError.
    with pytest.raises(ValueError):
        getattr(tf2_geometry_msgs, name)(
            FUNCTIONS[name](), transform("map", "base", 1, xyzw=(float("nan"), 0, 0, 1))
        )


@pytest.mark.parametrize("wrong", [None, 5, SimpleNamespace(), Pose(), Vector3(), Transform()])
def test_an_object_that_cannot_be_transformed_is_refused(tf2_ros, buffer, wrong):
    # Of the messages ours knows how, but they have no header.
    is_message = type(wrong) in (Pose, Vector3, Transform)
    errors = (tf2_ros.TypeException, AttributeError) if is_message else tf2_ros.TypeException
    for call in (buffer.transform, lambda *arguments: buffer.transform_full(*arguments, at(1), "map")):
        with pytest.raises(errors):
            call(wrong, "map")


def test_an_object_of_ones_own_without_a_header_is_an_attribute_error(tf2_ros, buffer):
    class Own:
        pass

    tf2_ros.TransformRegistration().add(Own, lambda own, t: own)
    with pytest.raises(AttributeError, match="header"):
        buffer.transform(Own(), "map")


def test_other_times_timeouts_and_authorities_are_type_errors(buffer):
    ask = (buffer.lookup_transform, buffer.can_transform)
    for call, arguments in (
        *[
            (call, ("map", "base", wrong))
            for call in (*ask, buffer.wait_for_transform_async)
            for wrong in (None, True, 1.5, SimpleNamespace())
        ],
        *[
            (call, ("nowhere", "base", Time(), wrong))
            for call in ask
            for wrong in (None, True, "5", Time(seconds=5))
        ],
        (buffer.set_transform, (TransformStamped(), None)),
    ):
        with pytest.raises(TypeError):
            call(*arguments)
