"""Importing this module raises ImportError, naming what to do, where what needs ROS 2 cannot run."""

from tf2_ros_cython._presence import HAS_ROS, absence

if not HAS_ROS:
    raise absence()
