"""Importing this module raises ImportError, naming what to do, where tf2_ros cannot run."""

from tf2_ros_cython._ros import require_ros
from tf2_ros_cython._version import __version__ as __version__

require_ros()
