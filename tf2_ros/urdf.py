"""Compute the transforms of a robot's joints from its URDF and joint states, with or without ROS."""

from tf2_ros_tools.urdf import Joint, Robot, UrdfError, load

__all__ = ["Joint", "Robot", "UrdfError", "load"]
