# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs import from the engine besides its public names.

This is not a public interface and may change at any time. They import nothing else from this package, so that
its modules can be moved. ``_internal.pxd`` is the same for what they cimport.
"""

from tf2_py._objects import assumptions as assumptions
from tf2_py._objects import errors as errors
from tf2_py._objects import log as log
from tf2_py._objects import message_classes as message_classes
from tf2_py._objects.errors import MalformedObjectError as MalformedObjectError
from tf2_py._objects.errors import bad_name as bad_name
from tf2_py._objects.errors import class_name as class_name
from tf2_py._objects.errors import seconds as seconds
from tf2_py._objects.frame_names import is_invalid_name as is_invalid_name
from tf2_py._tf2_py import FOR_EVER_NS as FOR_EVER_NS
from tf2_py._tf2_py import as_times_ns as as_times_ns
from tf2_py._tf2_py import bool_of as bool_of
from tf2_py._tf2_py import duration_ns as duration_ns
from tf2_py._tf2_py import frame_name as frame_name
from tf2_py._tf2_py import keep_for_ever as keep_for_ever
from tf2_py._tf2_py import mask_of as mask_of
from tf2_py._tf2_py import matrices_from_rotations as matrices_from_rotations
from tf2_py._tf2_py import normalize as normalize
from tf2_py._tf2_py import policy_of as policy_of
from tf2_py._tf2_py import refused_transforms as refused_transforms
from tf2_py._tf2_py import serialize_as_ros as serialize_as_ros
from tf2_py._tf2_py import stamp_parts as stamp_parts
from tf2_py._tf2_py import time_ns as time_ns
