# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What commands know of publishers that have ended."""

from tf2_ros_tools.nodes.node_session import NodeSession, filled_buffer

from times_and_transforms import S
from waiting import until, until_told

from tf2_ros.records import Recording
from tf2_ros_tools.diagnosis.findings import Limits
from tf2_ros_tools.listening.session import TOPICS, Listening


def test_a_publisher_keeps_its_name_when_it_has_ended(node, peer):
    recording = Recording()
    with filled_buffer(node, recording) as buffer:
        heard = Listening(NodeSession(node, buffer, TOPICS), recording, None)
        talker = peer("-r", "__node:=short_lived")

        def publishers():
            # Sent again, until it was discovered. A report would look it up, too.
            talker.send(("map", "odom", S, 0.0))
            heard.drain()
            return set(heard._recording.publishers())

        until(publishers)
        until_told(lambda: heard.session.names.keys() >= publishers())
        talker.end()
        until(lambda: not node.get_publishers_info_by_topic("/tf"))
        [one] = heard.report(Limits()).streams
        assert one.publisher == "/short_lived"
