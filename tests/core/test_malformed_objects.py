"""What raises for objects that lack what their role needs: the exceptions that programs of tf2 catch."""

from types import SimpleNamespace

import pytest
from geometry_msgs.msg import (
    Point,
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
@pytest.mark.parametrize(
    "wrong",
    [None, 5, "text", object(), SimpleNamespace(header=1), Quaternion()],
    ids=lambda w: type(w).__name__,
)
def test_another_object_is_an_attribute_error(name, t, wrong):
    with pytest.raises(AttributeError):
        getattr(tf2_geometry_msgs, name)(wrong, t)


@every_function
@pytest.mark.parametrize(
    "wrong",
    [None, 5, Pose(), SimpleNamespace(), SimpleNamespace(transform=SimpleNamespace(translation=Vector3()))],
    ids=["None", "5", "Pose", "nothing", "no rotation"],
)
def test_another_transform_is_an_attribute_error(name, wrong):
    with pytest.raises(AttributeError):
        getattr(tf2_geometry_msgs, name)(FUNCTIONS[name](), wrong)


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name != "do_transform_pose"])
def test_a_transform_without_a_header_is_an_attribute_error(name, t):
    for headless in (SimpleNamespace(transform=t.transform), t.transform):
        with pytest.raises(AttributeError):
            getattr(tf2_geometry_msgs, name)(FUNCTIONS[name](), headless)


@every_function
def test_a_rotation_that_is_no_number_is_a_value_error(name):
    if name == "do_transform_polygon_stamped":
        pytest.skip("an empty polygon asks for no rotation")
    with pytest.raises(ValueError):  # NumPy's LinAlgError is one
        getattr(tf2_geometry_msgs, name)(
            FUNCTIONS[name](), transform("map", "base", 1, xyzw=(float("nan"), 0, 0, 1))
        )


@pytest.mark.parametrize(
    "wrong", [None, 5, Pose(), Point(), Vector3(), Quaternion(), Transform(), SimpleNamespace()]
)
def test_an_object_that_cannot_be_transformed_is_a_type_exception(tf2_ros, buffer, wrong):
    # Of some of them a buffer knows how, but not when and from where.
    with pytest.raises(tf2_ros.TypeException):
        buffer.transform(wrong, "map")
    with pytest.raises(tf2_ros.TypeException):
        buffer.transform_full(wrong, "map", at(1), "map")


def test_an_object_of_ones_own_without_a_header_is_an_attribute_error(tf2_ros, buffer):
    class Own:
        pass

    tf2_ros.TransformRegistration().add(Own, lambda own, t: own)
    with pytest.raises(AttributeError, match="header"):
        buffer.transform(Own(), "map")
    with pytest.raises(AttributeError, match="header"):
        buffer.transform_full(Own(), "map", at(1), "map")


@pytest.mark.parametrize("wrong", [None, True, 1.5, SimpleNamespace()], ids=str)
def test_another_time_is_a_type_error(buffer, wrong):
    for call in (buffer.lookup_transform, buffer.can_transform, buffer.wait_for_transform_async):
        with pytest.raises(TypeError):
            call("map", "base", wrong)


@pytest.mark.parametrize("wrong", [None, True, "5", Time(seconds=5)], ids=str)
def test_another_timeout_is_a_type_error(buffer, wrong):
    for call in (buffer.lookup_transform, buffer.can_transform):
        with pytest.raises(TypeError):
            call("nowhere", "base", Time(), wrong)


def test_an_authority_that_is_no_text_is_a_type_error(buffer):
    with pytest.raises(TypeError):
        buffer.set_transform(TransformStamped(), None)
