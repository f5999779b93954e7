"""The types of geometry_msgs and nav_msgs carried from frame to frame."""

# Public programs take message classes from here; they stay outside __all__.
from geometry_msgs.msg import (  # noqa: F401
    AccelStamped,
    Point,
    Point32,
    PointStamped,
    Polygon,
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    TwistStamped,
    Vector3,
    Vector3Stamped,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)

from tf2_geometry_msgs.tf2_geometry_msgs import *  # noqa: F403
from tf2_geometry_msgs.tf2_geometry_msgs import __all__ as __all__
