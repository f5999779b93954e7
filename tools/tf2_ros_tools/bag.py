"""Load recordings into buffers, and save buffers as recordings, with or without ROS."""

from tf2_ros_tools.bag_loader import load, stamps, transforms
from tf2_ros_tools.bag_reader import BagError
from tf2_ros_tools.datasets import Dataset, dataset
from tf2_ros_tools.map_recordings import MappedRecordings, map_recordings
from tf2_ros_tools.optional_libraries import require
from tf2_ros_tools.saved_buffers import load_saved, save
from tf2_ros_tools.trajectories import Trajectory

# Now, because a program may need them only when it saves what it has recorded for an hour.
require("rosbags", "bag")
require("mcap", "bag")
require("tqdm", "bag")

__all__ = [
    "BagError",
    "Dataset",
    "MappedRecordings",
    "Trajectory",
    "dataset",
    "load",
    "load_saved",
    "map_recordings",
    "save",
    "stamps",
    "transforms",
]
