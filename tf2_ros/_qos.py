"""Quality of service of /tf, /tf_static and the lookup action."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile


def transforms_qos(depth: int, *, is_static: bool) -> QoSProfile:
    """The default profile of a topic of transforms."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if is_static else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST, durability=durability)


def lookup_qos() -> QoSProfile:
    """The profile of the services of the action."""
    # One transform may answer many goals at once; the usual queue of ten would lose the first answers.
    return QoSProfile(history=HistoryPolicy.KEEP_ALL)
