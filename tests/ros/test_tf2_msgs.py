# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The interfaces of tf2: their type hashes, which are those of their fields, and the numbers of errors."""

import ctypes

import pytest
from processes import output_of

pytest.importorskip("rclpy")

from tf2_msgs.msg import TF2Error
from tf2_ros_cython._ros_in_use import running_release

pytestmark = pytest.mark.tf2

TYPE_HASHES = {
    "msg/TFMessage": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "msg/TF2Error": "RIHS01_db2485e7d6a0ec75bf087e058ee45df682acc3a621ca7780503d10aac141809a",
    "srv/FrameGraph": "RIHS01_0d1fbc6222c018ba5f33822904a2fdd4063705289956d3fdde07cd8c50fe8067",
    "action/LookupTransform": "RIHS01_0b8adf6bc0b5958879e3265b41a457e03558fe523890a81252c70eba97a82c5d",
}


class TypeHash(ctypes.Structure):
    """rosidl's `rosidl_type_hash_t`."""

    _fields_ = [("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32)]


@pytest.mark.parametrize("name", TYPE_HASHES)
def test_type_hash_in_the_type_support_is_that_of_ros(name):
    """The compiled type support is what rcl and the RMW ask; the Python classes carry no hash."""
    kind, interface = name.split("/")
    # By bare name, as ROS opens them: it is loaded already.
    library = ctypes.CDLL("libtf2_msgs__rosidl_generator_c.so")
    symbol = f"tf2_msgs__{kind}__{interface}__get_type_hash"
    if running_release() == "Humble" and not hasattr(library, symbol):
        pytest.skip("Humble's interfaces have no hash")
    get_type_hash = library[symbol]
    get_type_hash.argtypes = [ctypes.c_void_p]
    get_type_hash.restype = ctypes.POINTER(TypeHash)
    type_hash = get_type_hash(None).contents
    assert f"RIHS{type_hash.version:02}_{bytes(type_hash.value).hex()}" == TYPE_HASHES[name]


def test_error_numbers_are_those_of_ros():
    names = ("NO", "LOOKUP", "CONNECTIVITY", "EXTRAPOLATION", "INVALID_ARGUMENT", "TIMEOUT", "TRANSFORM")
    assert [getattr(TF2Error, f"{name}_ERROR") for name in names] == list(range(7))


def test_messages_import_before_rclpy():
    output_of("-c", "import sys, tf2_msgs.msg; assert 'rclpy' not in sys.modules; tf2_msgs.msg.TFMessage()")
