# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read clouds into NumPy arrays and create clouds from them, if sensor_msgs_py is missing."""

import sys
from array import array
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.lib.recfunctions import unstructured_to_structured
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from tf2_sensor_msgs._cloud import as_bytes
from tf2_sensor_msgs._time_field import NAMES


def _dtype(fields: Iterable[Any], point_step: int | None, order: Literal["<", ">", "="]) -> "np.dtype[Any]":
    # A field of several numbers becomes several fields: name_0, name_1, ...
    names: list[str] = []
    formats: list[np.dtype[Any]] = []
    offsets: list[int] = []
    for index, field in enumerate(fields):
        kind = np.dtype(NAMES[field.datatype]).newbyteorder(order)
        name = field.name or f"unnamed_field_{index}"
        for number in range(field.count):
            names.append(f"{name}_{number}" if field.count > 1 else name)
            formats.append(kind)
            offsets.append(field.offset + number * kind.itemsize)
    layout: dict[str, Any] = {"names": names, "formats": formats, "offsets": offsets}
    if point_step is not None:
        layout["itemsize"] = point_step
    return np.dtype(layout)  # type: ignore[call-overload,no-any-return,unused-ignore]


def read_points(
    cloud: PointCloud2,
    field_names: Iterable[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[int] | None = None,
    reshape_organized_cloud: bool = False,
) -> NDArray[Any]:
    """
    Read a cloud's points into a structured array.

    :param cloud: the cloud; its rows must follow each other without padding.
    :param field_names: the fields to read; None: all.
    :param skip_nans: leave out points with a NaN, unless the cloud is dense.
    :param uvs: indices of the points to read; None: all.
    :param reshape_organized_cloud: return an array of shape (width, height) if there are several rows.
    :return: the points, in this machine's byte order.
    :raises AssertionError: it is not a cloud, or lacks a field.
    :raises TypeError: the data has too few bytes.
    """
    assert isinstance(cloud, PointCloud2), "a sensor_msgs/PointCloud2 is wanted"
    dtype = _dtype(cloud.fields, cloud.point_step, ">" if cloud.is_bigendian else "<")
    points = np.ndarray((cloud.width * cloud.height,), dtype, as_bytes(cloud.data))
    if field_names is not None:
        wanted = list(field_names)
        assert set(wanted) <= set(dtype.names or ()), f"of {wanted} the cloud has only {dtype.names}"
        points = points[wanted]
    if not points.dtype.isnative:
        points = points.astype(points.dtype.newbyteorder("="))
    if skip_nans and not cloud.is_dense:
        valid = np.ones(len(points), bool)
        for name in points.dtype.names or ():
            valid &= ~np.isnan(points[name])
        points = points[valid]
    if uvs is not None:
        points = points[uvs if isinstance(uvs, np.ndarray) else np.fromiter(uvs, int)]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.width, cloud.height)
    return points


def create_cloud(
    header: Header, fields: Sequence[Any], points: Any, point_step: int | None = None
) -> PointCloud2:
    """
    Make a cloud of points.

    :param header: its header.
    :param fields: its PointFields.
    :param points: a structured array, an array with a column for each field, or one iterable for each point.
    :param point_step: bytes from one point to the next; None: as many as the fields need.
    :raises AssertionError: the points do not fit the fields.
    """
    dtype = _dtype(fields, point_step, "=")
    if not isinstance(points, np.ndarray):
        rows = np.array([tuple(point) for point in points], dtype)
    elif points.dtype.names is None:
        assert len({field.datatype for field in fields}) == 1, "columns of one array are of one datatype"
        rows = unstructured_to_structured(points, dtype)
    else:
        assert points.dtype == dtype, f"points of {points.dtype} do not fit the fields, which are {dtype}"
        rows = points
    assert rows.ndim <= 2, "points lie in one or two dimensions"
    width = rows.shape[0]
    message = PointCloud2(
        header=header,
        height=rows.shape[1] if rows.ndim == 2 else 1,
        width=width,
        fields=fields,
        is_bigendian=sys.byteorder == "big",
        is_dense=False,
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * width,
    )
    message.data = array("B", rows.tobytes())
    return message
