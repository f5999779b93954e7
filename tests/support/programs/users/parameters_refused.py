# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A node that decides on parameters itself, and knows only its own, makes broadcasters and a listener."""

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node

import tf2_ros


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self.declare_parameter("rate", 10)
        self.add_on_set_parameters_callback(self.on_parameters)
        self.broadcaster = tf2_ros.TransformBroadcaster(self)
        print("broadcaster made")

    def on_parameters(self, parameters):
        result = SetParametersResult()
        for parameter in parameters:
            if parameter.name == "rate":
                result.successful = True
        return result


rclpy.init()
robot = Robot()
changed = robot.set_parameters([rclpy.parameter.Parameter("rate", value=20)])
print("rate changed:", changed[0].successful, robot.get_parameter("rate").value)

rclpy.shutdown()
