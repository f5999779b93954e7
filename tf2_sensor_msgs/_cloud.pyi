from typing import Any

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2

def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2: ...
def sampled_range(cloud: PointCloud2, name: str) -> tuple[float, float]: ...
def read_times(
    cloud: PointCloud2, name: str | None, unit: int, stamp_ns: int, times: npt.NDArray[np.int64]
) -> tuple[int, int, int]: ...
def split_times(edges_ns: npt.NDArray[np.int64], pieces: int) -> npt.NDArray[np.int64]: ...
def largest_bends(matrices: npt.NDArray[np.float64]) -> tuple[float, float]: ...
def move_points(
    cloud: PointCloud2,
    new_stamp_ns: int,
    frame_id: str,
    is_dense: bool,
    name: str | None,
    unit: int,
    stamp_ns: int,
    stored: float | None,
    times: npt.NDArray[np.int64] | None,
    knots_ns: npt.NDArray[np.int64] | None,
    matrices: npt.NDArray[np.float64],
) -> tuple[PointCloud2, bool]: ...
def transform_points(
    point_cloud: npt.ArrayLike, transform: TransformStamped | Transform
) -> npt.NDArray[Any]: ...
