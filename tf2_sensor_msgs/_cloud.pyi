# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2

from tf2_sensor_msgs._time_field import TimeField

def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2: ...
def as_bytes(data: Any) -> Any: ...

class Span(NamedTuple):
    lowest: float
    highest: float
    points: int
    finite: int
    large: int

class Points:
    cloud: PointCloud2
    def __new__(cls, cloud: PointCloud2) -> Points: ...
    def __len__(self) -> int: ...
    def find_span(self, field: TimeField, needs_point: bool) -> Span: ...
    def read_times(self, field: TimeField | None, times: npt.NDArray[np.int64]) -> tuple[int, float]: ...
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
    ) -> PointCloud2: ...

def transform_points(
    point_cloud: npt.ArrayLike, transform: TransformStamped | Transform
) -> npt.NDArray[Any]: ...
