"""Buffers from recordings, with ROS or without it."""

from tf2_ros._recordings.fleet import MappedRecordings, map_recordings
from tf2_ros._recordings.loading import load, stamps, transforms
from tf2_ros._recordings.problems import BagError, BagWarning

__all__ = ["BagError", "BagWarning", "MappedRecordings", "load", "map_recordings", "stamps", "transforms"]
