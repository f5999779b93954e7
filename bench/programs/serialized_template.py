# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Serialize messages of many transforms once, and then change only their stamp and their x."""

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.serialization import serialize_message

from tf2_msgs.msg import TFMessage

NS_PER_S = 10**9
# Found again among the bytes.
MARK_STAMP = (0x12345678, 0x2468ACE0)
MARK_X = 1.5e-300


class Template:
    """
    A serialized message of transforms.

    :param count: of them, from map to f0, f1, ...
    """

    def __init__(self, count):
        transforms = []
        for i in range(count):
            transform = TransformStamped(child_frame_id=f"f{i}")
            transform.header.frame_id = "map"
            transform.header.stamp.sec, transform.header.stamp.nanosec = MARK_STAMP
            transform.transform.translation.x = MARK_X
            transforms.append(transform)
        data = bytes(serialize_message(TFMessage(transforms=transforms)))
        self._bytes = np.frombuffer(data, np.uint8).copy()
        self._stamps = _places(data, np.array(MARK_STAMP, "<u4"), count)
        self._xs = _places(data, np.array([MARK_X], "<f8"), count)

    def message(self, stamp_ns, x):
        """Its bytes, with this stamp and x in every transform."""
        self._bytes[self._stamps] = np.array(divmod(stamp_ns, NS_PER_S), "<u4").view(np.uint8)
        self._bytes[self._xs] = np.array([x], "<f8").view(np.uint8)
        return self._bytes.tobytes()


def _places(data, mark, count):
    places = []
    while (place := data.find(mark.tobytes(), places[-1] + 1 if places else 0)) >= 0:
        places.append(place)
    assert len(places) == count
    return np.array(places)[:, None] + np.arange(mark.nbytes)
