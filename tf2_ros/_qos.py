# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quality of service of /tf, /tf_static and the lookup action."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

# Messages in the queues of a listener. All publishers of static transforms send theirs to a listener that
# starts later at the same time, and only once: what does not fit into the queue is lost for good. So it has
# room for more publishers than any robot has; for some, tf2's 100 do not suffice. A queue needs memory for
# the messages that wait in it, not for its depth.
DYNAMIC_DEPTH = 100
STATIC_DEPTH = 10_000


def transforms_qos(depth: int, *, is_static: bool) -> QoSProfile:
    """The default profile of a topic of transforms."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if is_static else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST, durability=durability)


def is_latched(qos: QoSProfile) -> bool:
    """Whether a subscription reliably receives the messages that its publishers sent before it existed."""
    wanted = DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE
    return (qos.durability, qos.reliability) == wanted


def lookup_qos() -> dict[str, QoSProfile]:
    """The profiles of the services of the action, as arguments of its client and of its server."""
    # One transform may answer many goals at once; the usual queue of ten would lose the first answers.
    keep_all = QoSProfile(history=HistoryPolicy.KEEP_ALL)
    return {f"{service}_service_qos_profile": keep_all for service in ("goal", "result", "cancel")}
