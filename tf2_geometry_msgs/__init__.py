"""Transform messages of geometry_msgs and nav_msgs from frame to frame."""

import tf2_ros_cython._requirement  # noqa: F401

from typing import TYPE_CHECKING

from tf2_geometry_msgs import tf2_geometry_msgs
from tf2_geometry_msgs._types import TYPES as _TYPES
from tf2_geometry_msgs.tf2_geometry_msgs import *  # noqa: F403
from tf2_ros._registration import names_of as _names_of

if TYPE_CHECKING:  # the table's functions, as their stubs declare them
    from tf2_geometry_msgs._geometry import *  # noqa: F403
    from tf2_geometry_msgs._nav import *  # noqa: F403

# Types that tf2 lacks, and message classes, which public programs take from here, stay outside __all__.
globals().update(_names_of(_TYPES))

__all__ = ["tf2_geometry_msgs"]
__all__ += tf2_geometry_msgs.__all__
