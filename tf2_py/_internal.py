"""
What tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs import from the engine besides its public names.

Not a public interface: it may change at any time. They import nothing else of this package, so that
its modules can be moved; what they cimport stands in ``_internal.pxd``.
"""

from tf2_py._objects import log
from tf2_py._objects.at_exit import keep_for_ever, skip_exit_handlers
from tf2_py._objects.errors import MalformedObjectError, bad_name, seconds
from tf2_py._objects.frame_names import is_invalid_name
from tf2_py._objects.printable import class_name, counted, printable
from tf2_py._objects.rotations import normalise
from tf2_py._objects.serialize import serialize_transforms
from tf2_py._objects.times import FOR_EVER_NS, duration_ns, stamp_parts, time_ns

__all__ = [
    "FOR_EVER_NS",
    "MalformedObjectError",
    "bad_name",
    "class_name",
    "counted",
    "duration_ns",
    "is_invalid_name",
    "keep_for_ever",
    "log",
    "normalise",
    "printable",
    "seconds",
    "serialize_transforms",
    "skip_exit_handlers",
    "stamp_parts",
    "time_ns",
]
