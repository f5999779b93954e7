# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Runs a program of the tools that listens until it has heard what a test needs, however long its options say.

`runs_tool_until_heard.py CONDITION PROGRAM ARGUMENT ...`: an expression over `streams`, by the names of their
frames, the texts of all `findings`, and the `feed`; last, `told()`: whether all publishers are known by name.
If that does not become true, the program ends with the status NEVER_TOLD. With the environment variable
HEARS_WITHOUT_ROS, there is no rclpy.
"""

import os
import re
import sys
import time

if "HEARS_WITHOUT_ROS" in os.environ:
    sys.modules.update(dict.fromkeys(("rclpy", "geometry_msgs", "tf2_msgs")))

from importlib import import_module

from waiting import NEVER_TOLD, TOLD_S, until

from tf2_ros_tools.diagnosis.findings import Limits
from tf2_ros_tools.listening.session import Listening

GID = re.compile(r"[0-9a-f]+\.\.[0-9a-f]+")  # what stands for a publisher without a name


def main(condition, name, *arguments):
    listen = Listening.listen

    def listen_on(self, seconds):
        asked = []

        def has_heard():
            listen(self, 0.1)
            report = self.report(Limits())

            def told():
                asked.append(time.monotonic())
                if asked[-1] - asked[0] > TOLD_S:
                    sys.exit(NEVER_TOLD)
                return GID.search(str(report)) is None

            known = {"streams": {one.frame: one for one in report.streams}, "feed": self.session.feed}
            return eval(condition, known | {"findings": [one.text for one in report.findings], "told": told})

        until(has_heard)

    Listening.listen = listen_on
    sys.exit(import_module(f"tf2_ros_tools.programs.{name}").main([name, *arguments]))


main(*sys.argv[1:])
