# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""Transform point clouds, in place on one copy of their bytes, and arrays of points."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2

from tf2_sensor_msgs._time_field import TimeField

def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2:
    """
    Transform a point cloud from the child frame of ``transform`` to its parent frame: p' = R p + t.

    In double precision, without the GIL.

    Fields may be in any order, at any offset, with any padding, in either byte order; x, y and z may be of
    any type, even of different ones; integers are truncated, as in tf2. If one coordinate of a point is NaN,
    all three are NaN in the result. Everything else stays as it is: other fields, padding, rows,
    ``is_dense``. However, a cloud with only x, y and z loses the padding after them, as in tf2, and a
    ``row_step`` that contradicts the data is corrected.

    Normals (``normal_x/y/z``) are rotated, and viewpoints (``vp_x/y/z``) rotated and translated, if a cloud
    has all three as float32 or float64. tf2's C++ also rotates normals, but not viewpoints; its Python
    transforms only x, y and z.

    :param cloud: a PointCloud2, coordinates in meters.
    :param transform: a TransformStamped, or a Transform, which leaves the cloud's frame unchanged; meters.
    :param only_xyz: leave normals and viewpoints unchanged.
    :return: a new PointCloud2 with the transform's frame and the cloud's own stamp.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: x, y or z is missing, not a number or beyond ``point_step`` (as in tf2 also an
        AssertionError), ``data`` is too short for the points, or a row too long for ``row_step`` (also a
        TypeError), or the transform's rotation is not finite.
    """

def as_bytes(data: Any) -> Any:
    """Return the ``data`` of a cloud, or a copy if that is not a buffer of contiguous bytes."""

class Span(NamedTuple):
    """What the numbers in a field of times are like; see FieldSpan in avx2_points.h."""

    lowest: float
    highest: float
    points: int
    finite: int
    large: int

class Points:
    """
    The points of a cloud, whose layout is validated once.

    :raises MalformedObjectError: an attribute of the cloud, its header or one of its fields is missing.
    :raises TypeError, ValueError: as by :func:`do_transform_cloud`.
    """

    cloud: PointCloud2
    def __new__(cls, cloud: PointCloud2) -> Points: ...
    def __len__(self) -> int:
        """Return len(self)."""
    def find_span(self, field: TimeField, needs_point: bool) -> Span:
        """
        Read the numbers in a field of times, once.

        :param field: a ``TimeField``.
        :param needs_point: omit points without coordinates.
        """
    def read_times(self, field: TimeField | None, times: npt.NDArray[np.int64]) -> tuple[int, float]:
        """
        Read the time of each point that has three coordinates.

        :param field: a ``TimeField``; None: ``times`` holds the times already.
        :param times: int64 nanoseconds, one for each point, row by row; receives the times, and the least
            integer where a point has none.
        :return: the index of the first point that has coordinates, but whose time is not a number, or -1; and
            what is there instead.
        """
    def moved(
        self,
        new_stamp_ns: int,
        frame_id: str,
        is_dense: bool,
        field: TimeField | None,
        stored: float | None,
        times: npt.NDArray[np.int64] | None,
        knots_ns: npt.NDArray[np.int64] | None,
        matrices: npt.NDArray[np.float64],
    ) -> PointCloud2:
        """
        Make a cloud in which each point is moved by the pose of its own time.

        :param new_stamp_ns: of the new cloud, which is in ``frame_id``.
        :param field: the ``TimeField`` with the times; None: there is none.
        :param stored: a number that each point gets in that field; None: they keep theirs.
        :param times: int64 nanoseconds, one for each point, instead of the field; None: use the field.
        :param knots_ns: int64 nanoseconds, ascending: the times of the poses, between which they change
            steadily; None: there is one pose for each point.
        :param matrices: of these poses: float64, shape (K, 4, 4), contiguous.
        """

def transform_points(point_cloud: npt.ArrayLike, transform: TransformStamped | Transform) -> npt.NDArray[Any]:
    """
    Transform points from the child frame of ``transform`` to its parent frame: p' = R p + t.

    In double precision, without the GIL.

    :param point_cloud: an array of shape (n, 3), x y z in meters, with any strides; or array-like.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new array of shape (n, 3): float32 for float32, otherwise float64.
    :raises TypeError: ``transform`` is of another type, or the points are not real numbers.
    :raises ValueError: the points have another shape, or the transform's rotation is not finite.
    """
