"""Owns measuring what is carried from frame to frame, beside NumPy (`python -m bench.types`)."""

from __future__ import annotations

import argparse
import array
import copy
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

import tf2_geometry_msgs as ours
from bench.rows import Row, row_of
from tf2_sensor_msgs import do_transform_cloud, transform_points

SECTION = "types"
CORNERS = 100
POINTS = 100_000
# What the Python of ROS 2 Jazzy needed, in us, on the machine of the published figures; and how often ours is
# to fit into that.
JAZZY_US = {"point": 22.7, "pose": 33.5, "pose with covariance": 57.0, "polygon of 100": 2638.0}
TARGETS = {"point": 30, "vector": 30, "pose": 30, "pose with covariance": 20, "polygon of 100": 100}
# Bytes from point to point, and the type of x y z.
CLOUDS = {
    "xyz": (12, "f4"),
    "xyz + intensity": (16, "f4"),
    "22 bytes": (22, "f4"),
    "32 bytes": (32, "f4"),
    "48 bytes": (48, "f4"),
    "xyz double": (24, "f8"),
}

Call = Callable[[], Any]


def run(quick: bool) -> list[dict[str, Any]]:
    """Rows of :mod:`bench.rows`: for messages the time of one call, for clouds and arrays too, in ns."""
    return measure(5, 0.02) if quick else measure(9, 0.2)


def measure(rounds: int, budget_s: float) -> list[dict[str, Any]]:
    """As :func:`run`, with so many rounds of so many seconds for each kind of call."""
    t = _transform()
    rows: list[Row] = []
    for name, (mine, peer) in _messages(t).items():
        rows += _race({"type": name}, {"ours": mine, "numpy": peer}, rounds, budget_s)
    for name, (step, kind) in CLOUDS.items():
        cloud = _cloud(step, kind)
        data = cloud.data
        calls: dict[str, Call] = {
            "ours": lambda cloud=cloud: do_transform_cloud(cloud, t),
            "numpy": lambda cloud=cloud, kind=kind: _cloud_by_numpy(cloud, t, kind),
            "copy of the bytes": lambda data=data: array.array("B", data),
            "copy of the message": lambda cloud=cloud: copy.deepcopy(cloud),
        }
        rows += _race({"type": f"cloud of {name}", "points": POINTS}, calls, rounds, budget_s)
    for kind in ("f4", "f8"):
        points = np.random.default_rng(1).uniform(-100, 100, (POINTS, 3)).astype(kind)
        calls = {
            "ours": lambda points=points: transform_points(points, t),
            "numpy": lambda points=points: _points_by_numpy(points, t),
            "copy of the bytes": lambda points=points: points.copy(),
        }
        rows += _race({"type": f"array of {kind}", "points": POINTS}, calls, rounds, budget_s)
    return [asdict(row) for row in rows]


def _race(labels: dict[str, Any], calls: dict[str, Call], rounds: int, budget_s: float) -> list[Row]:
    """Each in turn, round by round, each round beginning with another."""
    for call in calls.values():
        call()
    names = list(calls)
    values: dict[str, list[list[float]]] = {name: [] for name in names}
    for turn in range(rounds):
        for k in range(len(names)):
            name = names[(turn + k) % len(names)]
            values[name].append(_timed(calls[name], budget_s))
    return [row_of(SECTION, name, "call", labels, values[name]) for name in names]


def _timed(call: Call, budget_s: float) -> list[float]:
    empty = _loop(_nothing, 200, budget_s)
    subtracted = sorted(empty)[len(empty) // 2]
    return [ns - subtracted for ns in _loop(call, 100_000, budget_s)]


def _loop(call: Call, most: int, budget_s: float) -> list[int]:
    clock = time.perf_counter_ns
    end = clock() + int(budget_s * 1e9)
    times = []
    while len(times) < most and (len(times) < 5 or clock() < end):
        begin = clock()
        call()
        times.append(clock() - begin)
    return times


def _nothing() -> None:
    pass


def _transform() -> TransformStamped:
    t = TransformStamped(header=Header(frame_id="map"), child_frame_id="base")
    t.transform.translation = Vector3(x=1.0, y=2.0, z=3.0)
    t.transform.rotation = Quaternion(x=0.1, y=0.2, z=0.3, w=0.9)
    return t


def _messages(t: TransformStamped) -> dict[str, tuple[Call, Call]]:
    point = PointStamped(point=Point(x=4.0, y=5.0, z=6.0))
    vector = Vector3Stamped(vector=Vector3(x=4.0, y=5.0, z=6.0))
    pose = PoseStamped()
    pose.pose.position = point.point
    pose.pose.orientation = Quaternion(x=0.4, y=0.3, z=0.2, w=0.1)
    with_covariance = PoseWithCovarianceStamped()
    with_covariance.pose.pose = pose.pose
    with_covariance.pose.covariance = np.arange(36.0)
    polygon = PolygonStamped()
    polygon.polygon.points = [Point32(x=float(i), y=1.0, z=2.0) for i in range(CORNERS)]
    return {
        "point": (lambda: ours.do_transform_point(point, t), lambda: _point_by_numpy(point, t)),
        "vector": (lambda: ours.do_transform_vector3(vector, t), lambda: _vector_by_numpy(vector, t)),
        "pose": (lambda: ours.do_transform_pose_stamped(pose, t), lambda: _pose_by_numpy(pose, t)),
        "pose with covariance": (
            lambda: ours.do_transform_pose_with_covariance_stamped(with_covariance, t),
            lambda: _covariance_by_numpy(with_covariance, t),
        ),
        f"polygon of {CORNERS}": (
            lambda: ours.do_transform_polygon_stamped(polygon, t),
            lambda: _polygon_by_numpy(polygon, t),
        ),
    }


def _rotation(q: Quaternion) -> np.ndarray:
    x, y, z, w = np.array([q.x, q.y, q.z, q.w]) / np.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _translation(t: TransformStamped) -> np.ndarray:
    v = t.transform.translation
    return np.array([v.x, v.y, v.z])


def _header(t: TransformStamped) -> Header:
    return Header(stamp=copy.copy(t.header.stamp), frame_id=t.header.frame_id)


def _point_by_numpy(message: PointStamped, t: TransformStamped) -> PointStamped:
    p = message.point
    x, y, z = (_rotation(t.transform.rotation) @ np.array([p.x, p.y, p.z]) + _translation(t)).tolist()
    return PointStamped(header=_header(t), point=Point(x=x, y=y, z=z))


def _vector_by_numpy(message: Vector3Stamped, t: TransformStamped) -> Vector3Stamped:
    v = message.vector
    x, y, z = (_rotation(t.transform.rotation) @ np.array([v.x, v.y, v.z])).tolist()
    return Vector3Stamped(header=_header(t), vector=Vector3(x=x, y=y, z=z))


def _product(a: Quaternion, b: Quaternion) -> np.ndarray:
    x, y, z, w = a.x, a.y, a.z, a.w
    left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    q = left @ np.array([b.x, b.y, b.z, b.w])
    q /= np.linalg.norm(q)
    return -q if q[3] < 0 else q


def _pose_by_numpy(message: PoseStamped, t: TransformStamped) -> PoseStamped:
    p = message.pose.position
    x, y, z = (_rotation(t.transform.rotation) @ np.array([p.x, p.y, p.z]) + _translation(t)).tolist()
    q = _product(t.transform.rotation, message.pose.orientation).tolist()
    got = PoseStamped(header=_header(t))
    got.pose.position = Point(x=x, y=y, z=z)
    got.pose.orientation = Quaternion(x=q[0], y=q[1], z=q[2], w=q[3])
    return got


def _covariance_by_numpy(
    message: PoseWithCovarianceStamped, t: TransformStamped
) -> PoseWithCovarianceStamped:
    got = PoseWithCovarianceStamped(header=_header(t))
    got.pose.pose = _pose_by_numpy(message.pose, t).pose
    r = _rotation(t.transform.rotation)
    blocks = message.pose.covariance.reshape(2, 3, 2, 3).transpose(0, 2, 1, 3)
    got.pose.covariance = (r @ blocks @ r.T).transpose(0, 2, 1, 3).reshape(36)
    return got


def _polygon_by_numpy(message: PolygonStamped, t: TransformStamped) -> PolygonStamped:
    corners = np.array([(p.x, p.y, p.z) for p in message.polygon.points])
    carried = corners @ _rotation(t.transform.rotation).T + _translation(t)
    got = PolygonStamped(header=_header(t))
    got.polygon.points = [Point32(x=x, y=y, z=z) for x, y, z in carried.tolist()]
    return got


def _cloud(step: int, kind: str) -> PointCloud2:
    size = int(kind[1])
    datatype = PointField.FLOAT32 if kind == "f4" else PointField.FLOAT64
    fields = [PointField(name=n, offset=i * size, datatype=datatype, count=1) for i, n in enumerate("xyz")]
    if step > 3 * size:
        # Otherwise the rest were padding, which a cloud of x, y and z alone loses.
        fields.append(PointField(name="intensity", offset=3 * size, datatype=PointField.FLOAT32, count=1))
    points = np.zeros(
        POINTS,
        np.dtype(
            {"names": list("xyz"), "formats": [kind] * 3, "offsets": [0, size, 2 * size], "itemsize": step}
        ),
    )
    random = np.random.default_rng(1)
    for axis in "xyz":
        points[axis] = random.uniform(-100, 100, POINTS)
    return PointCloud2(
        header=Header(frame_id="base"),
        height=1,
        width=POINTS,
        fields=fields,
        point_step=step,
        row_step=step * POINTS,
        data=array.array("B", points.tobytes()),
        is_dense=True,
    )


def _cloud_by_numpy(cloud: PointCloud2, t: TransformStamped, kind: str) -> array.array[int]:
    """In double precision, column by column, which is faster than one product of matrices."""
    data = array.array("B", cloud.data)
    size = int(kind[1])
    x, y, z = (np.ndarray(cloud.width, kind, data, i * size, cloud.point_step) for i in range(3))
    r, v = _rotation(t.transform.rotation), _translation(t)
    columns = [column.astype(np.float64) for column in (x, y, z)]
    for out, row, offset in zip((x, y, z), r, v, strict=True):
        out[:] = row[0] * columns[0] + row[1] * columns[1] + row[2] * columns[2] + offset
    return data


def _points_by_numpy(points: np.ndarray, t: TransformStamped) -> np.ndarray:
    carried = points.astype(np.float64) @ _rotation(t.transform.rotation).T + _translation(t)
    return carried.astype(points.dtype, copy=False)


def table(rows: list[dict[str, Any]]) -> str:
    """One line for each type: our time, how often it fits into the others', and what is wanted."""
    medians: dict[str, dict[str, float]] = {}
    for row in rows:
        medians.setdefault(row["labels"]["type"], {})[row["who"]] = row["median"] / 1000
    lines = []
    for name, us in medians.items():
        facts = [f"{name:24} {us['ours']:9.2f} us", f"NumPy {us['numpy'] / us['ours']:6.1f} x"]
        if name in JAZZY_US:
            facts.append(f"published Jazzy {JAZZY_US[name] / us['ours']:6.1f} x")
        if name in TARGETS:
            facts.append(f"wanted {TARGETS[name]} x")
        facts += [f"{us['ours'] / us[who]:.2f} of a {who}" for who in us if who.startswith("copy")]
        lines.append("  ".join(facts))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="shorter rounds")
    print(table(run(parser.parse_args().quick)))


if __name__ == "__main__":
    main()
