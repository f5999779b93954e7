# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Records so many messages: `records_with_faulty_middleware.py MESSAGES`.

Run with `interposed/faulty_middleware.c` loaded.
Prints a line of JSON: when the transforms were received, and what a report says; or why none can be recorded.
"""

# First, as in the programs of the project.
from tf2_ros_tools.nodes.node_session import NodeSession, filled_buffer

import json
import sys

import rclpy
from waiting import until

from tf2_ros.records import Recording
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.diagnosis.findings import Limits
from tf2_ros_tools.listening.session import TOPICS, Listening


def record(node, messages):
    recording = Recording()
    with filled_buffer(node, recording) as buffer:
        heard = Listening(NodeSession(node, buffer, TOPICS), recording, None)
        until(lambda: heard._recording.messages >= messages)
        report = heard.report(Limits())
        return {
            "received_ns": heard.records()["received_ns"].tolist(),
            "publishers": {one.frame: one.publisher for one in report.streams},
            "findings": [one.text for one in report.findings],
        }


def main():
    rclpy.init()
    node = rclpy.create_node("recording")
    try:
        outcome = record(node, int(sys.argv[1]))
    except UsageError as error:
        outcome = {"error": str(error), "subscriptions": len([*node.subscriptions])}
    print(json.dumps(outcome))
    rclpy.shutdown()


main()
