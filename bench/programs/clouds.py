# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure clouds of one sweep: transformed as a whole, and each point at its own time."""

from array import array
from time import perf_counter_ns

import numpy as np
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import PointCloud2, PointField
from trees_and_queries import chain

from tf2_sensor_msgs import deskew, do_transform_cloud

POINTS = 100_000
SWEEP_NS = 100_000_000
MARGIN_NS = 1_000_000
SAMPLES = 100  # per frame
CALLS = 50
# The points of four drivers: bytes of a point, name, offset and type of the times, and their unit in ns; the
# last two are absolute.
KINDS = {
    "Velodyne": (22, "time", 18, "f4", 1e9),
    "Ouster": (48, "t", 20, "u4", 1),
    "Livox": (26, "timestamp", 18, "f8", 1),
    "Hesai": (26, "timestamp", 18, "f8", 1e9),
}
DATATYPES = {"f4": PointField.FLOAT32, "f8": PointField.FLOAT64, "u4": PointField.UINT32}


def clouds(rows, _, library):
    """A cloud of each driver, with a lidar that moves in 1 and 4 moving frames."""
    for hops in (1, 4):
        tree = chain("moving chain", hops, SAMPLES)
        library.load(tree)
        # Doubles of seconds may round a time to one before.
        frame, start_ns = tree.names[hops], tree.span_ns[0] + MARGIN_NS
        for driver, kind in KINDS.items():
            cloud = _cloud(frame, start_ns, *kind)
            transform = library.buffer.lookup_transform("world", frame, library.time_of(start_ns))
            labels = {"points of": driver, "hops": hops}
            _time(rows, labels, cloud, transform, library.buffer)


def _time(rows, labels, cloud, transform: TransformStamped, buffer):
    ways = {
        "do_transform_cloud": lambda: do_transform_cloud(cloud, transform),
        "deskew": lambda: deskew(cloud, buffer, "world"),
        "deskew, target moves": lambda: deskew(cloud, buffer, cloud.header.frame_id, "world"),
    }
    times = {way: [] for way in ways}
    for _ in range(CALLS):  # in turn, because the speed of the machine varies
        for way, call in ways.items():
            start = perf_counter_ns()
            call()
            times[way].append(perf_counter_ns() - start)
    for way in ways:
        rows.add(way, labels, np.array(times[way][1:]))


def _cloud(frame, start_ns, step, name, offset, kind, unit):
    names, formats, offsets = ["x", "y", "z", name], ["f4", "f4", "f4", kind], [0, 4, 8, offset]
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})
    points = np.zeros(POINTS, dtype)
    for axis in "xyz":
        points[axis] = np.random.default_rng(5).uniform(-100, 100, POINTS)
    ns = np.linspace(0, SWEEP_NS, POINTS).astype(np.int64)
    points[name] = (ns + start_ns if kind == "f8" else ns) / unit
    message = PointCloud2(height=1, width=POINTS, point_step=step, row_step=step * POINTS)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(start_ns, 1_000_000_000)
    message.fields = [
        PointField(name=name, offset=offset, datatype=DATATYPES[kind], count=1)
        for name, offset, kind in zip(names, offsets, formats, strict=True)
    ]
    message.data = array("B", points.tobytes())
    return message
