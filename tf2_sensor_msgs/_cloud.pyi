from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import PointCloud2

def do_transform_cloud(
    cloud: PointCloud2, transform: TransformStamped, *, only_xyz: bool = False
) -> PointCloud2: ...
