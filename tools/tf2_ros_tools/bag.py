# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Load and rewrite recordings, and save buffers as recordings, with or without ROS."""

from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.recordings.bag_loader import load, transforms
from tf2_ros_tools.recordings.bag_reader import BagError
from tf2_ros_tools.recordings.datasets import Dataset, dataset
from tf2_ros_tools.recordings.header_stamps import stamps
from tf2_ros_tools.recordings.rewriting import rewrite
from tf2_ros_tools.recordings.saved_buffers import save
from tf2_ros_tools.recordings.trajectories import Trajectory

# Now, because a program may need them only when it saves what it has recorded for an hour.
require("rosbags", "bag")
require("mcap", "bag")
require("tqdm", "bag")

__all__ = [
    "BagError",
    "Dataset",
    "Trajectory",
    "dataset",
    "load",
    "rewrite",
    "save",
    "stamps",
    "transforms",
]
