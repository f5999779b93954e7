from typing import Any

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2

from tf2_sensor_msgs._time_field import TimeField

def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2: ...
def as_bytes(data: Any) -> Any: ...
def require_cloud(cloud: PointCloud2) -> None: ...
def sample_times(
    cloud: PointCloud2, times: TimeField, needs_point: bool = True, every: bool = False
) -> npt.NDArray[np.float64]: ...
def read_times(
    cloud: PointCloud2, field: TimeField | None, times: npt.NDArray[np.int64]
) -> tuple[int, float]: ...
def move_points(
    cloud: PointCloud2,
    new_stamp_ns: int,
    frame_id: str,
    is_dense: bool,
    field: TimeField | None,
    stored: float | None,
    times: npt.NDArray[np.int64] | None,
    knots_ns: npt.NDArray[np.int64] | None,
    matrices: npt.NDArray[np.float64],
) -> tuple[PointCloud2, bool]: ...
def transform_points(
    point_cloud: npt.ArrayLike, transform: TransformStamped | Transform
) -> npt.NDArray[Any]: ...
