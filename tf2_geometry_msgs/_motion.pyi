from geometry_msgs.msg import (
    AccelStamped,
    Transform,
    TransformStamped,
    TwistStamped,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)

def do_transform_accel_stamped(accel: AccelStamped, transform: TransformStamped) -> AccelStamped: ...
def do_transform_twist_stamped(twist: TwistStamped, transform: TransformStamped) -> TwistStamped: ...
def do_transform_velocity_stamped(
    velocity: VelocityStamped, transform: TransformStamped
) -> VelocityStamped: ...
def do_transform_wrench(wrench: Wrench, transform: TransformStamped | Transform) -> Wrench: ...
def do_transform_wrench_stamped(wrench: WrenchStamped, transform: TransformStamped) -> WrenchStamped: ...
