# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What this project offers beside tf2's names: matrices, lookups at many times, many inserts in a call."""

import numpy as np
from geometry_msgs.msg import TransformStamped
from measured_library import AUTHORITY, by_pair
from rclpy.serialization import serialize_message
from tf2_ros_library import Tf2, fill

from tf2_msgs.msg import TFMessage

BATCH = 50


class Ours(Tf2):
    ways = (*Tf2.ways, "buffer, kept", "matrix", "matrix out")
    vector_ways = ("vector", "vector matrices")
    insert_ways = ("set_transform", "set_transforms", "set_transforms_cdr", "set_transforms_cdr of 1")

    def calls(self, way, queries):
        way, *kept = way.split(", ")
        self.call = "keep(function({}))" if kept else Tf2.call
        if way == "vector":
            return self.buffer.lookup_transforms, list(by_pair(queries))
        if way == "vector matrices":
            return self.buffer.lookup_matrices, list(by_pair(queries))
        if way.startswith("matrix"):
            out = (np.empty((4, 4)),) if way == "matrix out" else ()
            return self.buffer.lookup_matrix, [(a, b, self.time_of(ns), *out) for a, b, ns in queries]
        return super().calls(way, queries)

    def inserts(self, way, transforms):
        if way == "set_transform":
            return super().inserts(way, transforms)
        size = 1 if way.endswith("of 1") else BATCH
        messages = [fill(TransformStamped(), *transform) for transform in transforms]
        batches = [messages[i : i + size] for i in range(0, len(messages) - size + 1, size)]
        if way == "set_transforms":
            return self.buffer.set_transforms, [(batch, AUTHORITY) for batch in batches], size
        data = [bytes(serialize_message(TFMessage(transforms=batch))) for batch in batches]
        return self.buffer.set_transforms_cdr, [(message, AUTHORITY) for message in data], size
