from typing import Any

import numpy.typing as npt
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2

def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2: ...
def transform_points(
    point_cloud: npt.ArrayLike, transform: TransformStamped | Transform
) -> npt.NDArray[Any]: ...
