"""
What tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs import from the engine besides its public names.

This is not a public interface and may change at any time. They import nothing else from this package, so that
its modules can be moved. ``_internal.pxd`` lists what they cimport.
"""

from tf2_py._objects import errors, log, message_classes
from tf2_py._objects.errors import MalformedObjectError, bad_name, class_name, is_invalid_name, seconds
from tf2_py._tf2_py import (
    FOR_EVER_NS,
    as_times_ns,
    duration_ns,
    frame_name,
    keep_for_ever,
    mask_of,
    matrices_from_rotations,
    normalise,
    policy_of,
    refused,
    rotations_from_matrices,
    serialize_as_ros,
    stamp_parts,
    time_ns,
)

__all__ = [
    "FOR_EVER_NS",
    "MalformedObjectError",
    "as_times_ns",
    "bad_name",
    "class_name",
    "duration_ns",
    "errors",
    "frame_name",
    "is_invalid_name",
    "keep_for_ever",
    "log",
    "mask_of",
    "matrices_from_rotations",
    "message_classes",
    "normalise",
    "policy_of",
    "refused",
    "rotations_from_matrices",
    "seconds",
    "serialize_as_ros",
    "stamp_parts",
    "time_ns",
]
