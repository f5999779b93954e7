"""
What tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs import from the engine besides its public names.

Not a public interface: it may change at any time. They import nothing else of this package, so that
its modules can be moved; what they cimport stands in ``_internal.pxd``.
"""

from tf2_py._objects import log, message_classes, wait_texts
from tf2_py._objects.arguments import frame_name
from tf2_py._objects.arrays import as_times_ns, mask_of
from tf2_py._objects.at_exit import keep_for_ever
from tf2_py._objects.errors import MalformedObjectError, bad_name, seconds
from tf2_py._objects.frame_names import is_invalid_name
from tf2_py._objects.histories import History, histories
from tf2_py._objects.printable import class_name, counted, printable, three_digits
from tf2_py._objects.refusals import raise_refused, refused
from tf2_py._objects.rotations import matrices_from_rotations, normalise, rotations_from_matrices
from tf2_py._objects.serialize import serialize_transforms
from tf2_py._objects.times import FOR_EVER_NS, duration_ns, stamp_parts, time_ns, timeout_ns
from tf2_py._objects.whole_file import UNFINISHED, whole_file

__all__ = [
    "FOR_EVER_NS",
    "History",
    "MalformedObjectError",
    "UNFINISHED",
    "as_times_ns",
    "bad_name",
    "class_name",
    "counted",
    "duration_ns",
    "frame_name",
    "histories",
    "is_invalid_name",
    "keep_for_ever",
    "log",
    "mask_of",
    "matrices_from_rotations",
    "message_classes",
    "normalise",
    "printable",
    "raise_refused",
    "refused",
    "rotations_from_matrices",
    "seconds",
    "serialize_transforms",
    "stamp_parts",
    "three_digits",
    "time_ns",
    "timeout_ns",
    "wait_texts",
    "whole_file",
]
