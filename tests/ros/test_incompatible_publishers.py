# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The name of a publisher whose QoS is incompatible with that of a listener is logged."""

import pytest
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, qos_check_compatible
from waiting import errors_so_far, until

from tf2_msgs.msg import TFMessage

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# With Zenoh, every publisher fits every subscription.
pytestmark = [
    pytest.mark.ours,
    pytest.mark.skipif(
        qos_check_compatible(QoSProfile(depth=1), LATCHED)[0] != QoSCompatibility.ERROR,
        reason="this middleware knows no incompatible QoS",
    ),
]


def test_one_is_logged(listener, new_node, capfd):
    """The node is not spun, so no executor can log it."""
    other = new_node("volatile")
    other.create_publisher(TFMessage, "/tf_static", 10)
    until(lambda: "incompatible QoS" in errors_so_far())
    said = "Nothing is received from /volatile on /tf_static: Volatile publisher and transient local subscr"
    until(lambda: said in errors_so_far())


def test_one_is_named_once_the_graph_knows_its_node(ros, tf2_ros, buffer, new_node, capfd):
    asked = []

    class Knowing(ros.node.Node):
        """Knows the endpoints of other nodes before it knows these nodes, as the graph may."""

        def get_publishers_info_by_topic(self, topic):
            found = super().get_publishers_info_by_topic(topic)
            asked.append(len(found))
            if sum(map(bool, asked)) == 1:
                for one in found:
                    one.node_name = "_NODE_NAME_UNKNOWN_"
            return found

    node = Knowing("knowing")
    with tf2_ros.TransformListener(buffer, node):
        other = new_node("volatile")
        other.create_publisher(TFMessage, "/tf_static", 10)
        until(lambda: "Nothing is received from" in errors_so_far())
        assert "from /volatile on /tf_static" in errors_so_far()
    node.destroy_node()
