# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""Transform the types of nav_msgs. Importing this module needs nav_msgs."""

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry, Path

def do_transform_odometry(odometry: Odometry, transform: TransformStamped) -> Odometry:
    """
    Transform the pose of an Odometry from the child frame of ``transform`` to its parent frame.

    The twist is given in the axes of ``child_frame_id``, so it does not depend on the frame of the header.

    :param odometry: an Odometry, meters, radians and seconds.
    :param transform: a TransformStamped, meters.
    :return: a new Odometry with the transform's frame and stamp.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a covariance is not 36 numbers, or a rotation is not finite.
    """

def do_transform_path(path: Path, transform: TransformStamped) -> Path:
    """
    Transform each pose of a path from the child frame of ``transform`` to its parent frame.

    :param path: a Path, meters; its poses may leave their frame empty.
    :param transform: a TransformStamped, meters.
    :return: a new Path with the transform's frame and stamp; its poses have that frame and keep their stamps.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a pose has a frame other than the path's, or a rotation is not finite.
    """
