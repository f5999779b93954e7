from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2

def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped | Transform, *, only_xyz: bool = False
) -> PointCloud2: ...
