"""Show the frames of a buffer and their motion in rerun, without ROS."""

from tf2_ros_tools.rerun import ViewerError, log, save, view

__all__ = ["ViewerError", "log", "save", "view"]
