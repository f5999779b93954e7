from typing import Any

import numpy.typing as npt
from geometry_msgs.msg import Transform, TransformStamped

def transform_points(
    point_cloud: npt.ArrayLike, transform: TransformStamped | Transform
) -> npt.NDArray[Any]: ...
