"""The names that programs import: a change here is a change for them."""

import importlib

import pytest

pytestmark = pytest.mark.ours

TF2_PY = {
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
}
BUFFER_INTERFACE = {
    "BufferInterface",
    "ConvertRegistration",
    "MsgStamped",
    "NotImplementedException",
    "PyKDLType",
    "Stamped",
    "TransformRegistration",
    "TransformableObject",
    "TransformableObjectType",
    "TypeException",
    "convert",
}
LISTENER = {
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "StaticTransformListener",
    "TransformListener",
}
FILTER = {"FilterFailureReason", "MessageFilter"}
GEOMETRY = {
    "do_transform_accel_stamped",
    "do_transform_odometry",
    "do_transform_path",
    "do_transform_point",
    "do_transform_polygon",
    "do_transform_polygon_stamped",
    "do_transform_pose",
    "do_transform_pose_array",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_quaternion",
    "do_transform_quaternion_stamped",
    "do_transform_transform",
    "do_transform_transform_stamped",
    "do_transform_twist_stamped",
    "do_transform_vector3",
    "do_transform_velocity_stamped",
    "do_transform_wrench",
    "do_transform_wrench_stamped",
    "from_msg_msg",
    "to_msg_msg",
    "transform_covariance",
}
SENSORS = {
    "do_transform_cloud",
    "do_transform_imu",
    "do_transform_magnetic_field",
    "from_msg_msg",
    "to_msg_msg",
    "transform_points",
}
GEOMETRY_CLASSES = {
    "Point",
    "Point32",
    "PointStamped",
    "PolygonStamped",
    "Pose",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "TransformStamped",
    "Vector3Stamped",
}
PUBLIC = {
    "tf2_geometry_msgs": GEOMETRY,
    "tf2_geometry_msgs.tf2_geometry_msgs": GEOMETRY,
    "tf2_py": TF2_PY,
    "tf2_ros": TF2_PY
    | BUFFER_INTERFACE
    | LISTENER
    | FILTER
    | {"Buffer", "BufferClient", "BufferServer", "StaticTransformBroadcaster", "TransformBroadcaster"},
    "tf2_ros.buffer": {"Buffer"},
    "tf2_ros.buffer_client": {"BufferClient"},
    "tf2_ros.buffer_interface": BUFFER_INTERFACE,
    "tf2_ros.buffer_server": {"BufferServer"},
    "tf2_ros.cli.tf2_buffer_server": {"main"},
    "tf2_ros.message_filter": FILTER,
    "tf2_ros.numpy": {"from_matrix", "to_arrays", "to_matrix"},
    "tf2_ros.static_transform_broadcaster": {"StaticTransformBroadcaster"},
    "tf2_ros.static_transform_listener": LISTENER - {"TransformListener"},
    "tf2_ros.transform_broadcaster": {"TransformBroadcaster"},
    "tf2_ros.transform_listener": LISTENER,
    "tf2_sensor_msgs": SENSORS,
    "tf2_sensor_msgs.tf2_sensor_msgs": SENSORS,
}
# What programs import besides, because it was there.
KEPT = {
    "tf2_geometry_msgs": GEOMETRY_CLASSES,
    "tf2_geometry_msgs.tf2_geometry_msgs": GEOMETRY_CLASSES,
    "tf2_ros": {
        "Duration",
        "FrameGraph",
        "Header",
        "LookupTransform",
        "PointCloud2",
        "PointStamped",
        "PoseStamped",
        "PoseWithCovarianceStamped",
        "TFMessage",
        "Time",
        "TransformStamped",
        "Vector3Stamped",
    },
    "tf2_ros.buffer": {"Duration", "FrameGraph", "Time", "TransformStamped"},
    "tf2_ros.buffer_interface": {
        "Duration",
        "Header",
        "PointCloud2",
        "PointStamped",
        "PoseStamped",
        "PoseWithCovarianceStamped",
        "Time",
        "TransformStamped",
        "Vector3Stamped",
    },
    "tf2_ros.static_transform_broadcaster": {"TFMessage", "TransformStamped"},
    "tf2_ros.transform_broadcaster": {"TFMessage", "TransformStamped"},
    "tf2_ros.transform_listener": {"TFMessage"},
    "tf2_sensor_msgs": {"PointCloud2"},
    "tf2_sensor_msgs.tf2_sensor_msgs": {"PointCloud2", "Transform", "TransformStamped"},
}


@pytest.mark.parametrize("module", PUBLIC)
def test_a_module_has_just_these_public_names(module):
    module = importlib.import_module(module)
    assert sorted(module.__all__) == sorted(PUBLIC[module.__name__])
    assert [name for name in module.__all__ if not hasattr(module, name)] == []


@pytest.mark.parametrize("module", KEPT)
def test_names_that_programs_came_to_rely_on_are_still_there(module):
    module = importlib.import_module(module)
    assert [name for name in KEPT[module.__name__] if not hasattr(module, name)] == []


def test_an_exception_is_one_class_wherever_it_is_caught(tf2_py, tf2_ros):
    for name in TF2_PY:
        assert getattr(tf2_ros, name) is getattr(tf2_py, name)
