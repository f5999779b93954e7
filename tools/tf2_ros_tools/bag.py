"""Load recordings into buffers, with or without ROS."""

from tf2_ros_tools.datasets import Dataset, dataset
from tf2_ros_tools.fleet import MappedRecordings, map_recordings
from tf2_ros_tools.loading import load, stamps, transforms
from tf2_ros_tools.reading import BagError

__all__ = [
    "BagError",
    "Dataset",
    "MappedRecordings",
    "dataset",
    "load",
    "map_recordings",
    "stamps",
    "transforms",
]
