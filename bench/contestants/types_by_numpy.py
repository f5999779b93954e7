"""Owns the calls of `do_transform_*` of messages, clouds and arrays, beside the same arithmetic in NumPy."""

import array
import copy

import numpy as np
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from sensor_msgs.msg import PointCloud2, PointField
from serving import Contestant, serve
from std_msgs.msg import Header

import tf2_geometry_msgs as ours
from tf2_sensor_msgs import do_transform_cloud, transform_points

CORNERS = 100
# Bytes from point to point, and the type of x y z.
CLOUDS = {
    "xyz": (12, "f4"),
    "xyz + intensity": (16, "f4"),
    "22 bytes": (22, "f4"),
    "32 bytes": (32, "f4"),
    "48 bytes": (48, "f4"),
    "xyz double": (24, "f8"),
}


class Types(Contestant):
    def order_types(self, points):
        """Prepare every type, clouds of so many points; by type, whose call it is measured for."""
        t = transform()
        self.sets = {
            (who, name): (function, [(argument, t)])
            for name, (argument, functions) in cases(points).items()
            for who, function in functions.items()
        }
        types = {}
        for (who, name), (function, (arguments,)) in self.sets.items():
            function(*arguments)
            types.setdefault(name, []).append(who)
        return {"types": types}


def cases(points):
    """By type: what is transformed, and the functions of it and a transform."""
    found = {
        name: (message, {"ours": function, "numpy": by_numpy})
        for name, (message, function, by_numpy) in messages().items()
    }
    for name, (step, kind) in CLOUDS.items():
        found[f"cloud of {name}"] = (
            cloud(step, kind, points),
            {
                "ours": do_transform_cloud,
                "numpy": cloud_by_numpy,
                "copy of the bytes": lambda cloud, t: array.array("B", cloud.data),
                "copy of the message": lambda cloud, t: copy.deepcopy(cloud),
            },
        )
    for kind in ("f4", "f8"):
        table = np.random.default_rng(1).uniform(-100, 100, (points, 3)).astype(kind)
        found[f"array of {kind}"] = (
            table,
            {
                "ours": transform_points,
                "numpy": points_by_numpy,
                "copy of the bytes": lambda table, t: table.copy(),
            },
        )
    return found


def transform():
    t = TransformStamped(header=Header(frame_id="map"), child_frame_id="base")
    t.transform.translation = Vector3(x=1.0, y=2.0, z=3.0)
    t.transform.rotation = Quaternion(x=0.1, y=0.2, z=0.3, w=0.9)
    return t


def messages():
    """By type: a message, our function, NumPy's."""
    point = PointStamped(point=Point(x=4.0, y=5.0, z=6.0))
    vector = Vector3Stamped(vector=Vector3(x=4.0, y=5.0, z=6.0))
    pose = PoseStamped()
    pose.pose.position = point.point
    pose.pose.orientation = Quaternion(x=0.4, y=0.3, z=0.2, w=0.1)
    covariance = PoseWithCovarianceStamped()
    covariance.pose.pose = pose.pose
    covariance.pose.covariance = np.arange(36.0)
    polygon = PolygonStamped()
    polygon.polygon.points = [Point32(x=float(i), y=1.0, z=2.0) for i in range(CORNERS)]
    return {
        "point": (point, ours.do_transform_point, point_by_numpy),
        "vector": (vector, ours.do_transform_vector3, vector_by_numpy),
        "pose": (pose, ours.do_transform_pose_stamped, pose_by_numpy),
        "pose with covariance": (
            covariance,
            ours.do_transform_pose_with_covariance_stamped,
            covariance_by_numpy,
        ),
        f"polygon of {CORNERS}": (polygon, ours.do_transform_polygon_stamped, polygon_by_numpy),
    }


def rotation(t):
    q = t.transform.rotation
    x, y, z, w = np.array([q.x, q.y, q.z, q.w]) / np.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def translation(t):
    v = t.transform.translation
    return np.array([v.x, v.y, v.z])


def header(t):
    return Header(stamp=copy.copy(t.header.stamp), frame_id=t.header.frame_id)


def moved(p, t):
    x, y, z = (rotation(t) @ np.array([p.x, p.y, p.z]) + translation(t)).tolist()
    return Point(x=x, y=y, z=z)


def turned(b, t):
    a = t.transform.rotation
    x, y, z, w = a.x, a.y, a.z, a.w
    left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    q = left @ np.array([b.x, b.y, b.z, b.w])
    q /= np.linalg.norm(q)
    x, y, z, w = (-q if q[3] < 0 else q).tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def point_by_numpy(message, t):
    return PointStamped(header=header(t), point=moved(message.point, t))


def vector_by_numpy(message, t):
    v = message.vector
    x, y, z = (rotation(t) @ np.array([v.x, v.y, v.z])).tolist()
    return Vector3Stamped(header=header(t), vector=Vector3(x=x, y=y, z=z))


def pose_by_numpy(message, t):
    pose = message.pose
    pose = Pose(position=moved(pose.position, t), orientation=turned(pose.orientation, t))
    return PoseStamped(header=header(t), pose=pose)


def covariance_by_numpy(message, t):
    result = PoseWithCovarianceStamped(header=header(t))
    result.pose.pose = pose_by_numpy(message.pose, t).pose
    r = rotation(t)
    parts = message.pose.covariance.reshape(2, 3, 2, 3).transpose(0, 2, 1, 3)
    result.pose.covariance = (r @ parts @ r.T).transpose(0, 2, 1, 3).reshape(36)
    return result


def polygon_by_numpy(message, t):
    corners = points_by_numpy(np.array([(p.x, p.y, p.z) for p in message.polygon.points]), t)
    result = PolygonStamped(header=header(t))
    result.polygon.points = [Point32(x=x, y=y, z=z) for x, y, z in corners.tolist()]
    return result


def points_by_numpy(points, t):
    result = points.astype(np.float64, copy=False) @ rotation(t).T + translation(t)
    return result.astype(points.dtype, copy=False)


def cloud_by_numpy(cloud, t):
    """In double precision, column by column, which is faster than one product of matrices."""
    data = array.array("B", cloud.data)
    kind = "f4" if cloud.fields[0].datatype == PointField.FLOAT32 else "f8"
    x, y, z = (np.ndarray(cloud.width, kind, data, f.offset, cloud.point_step) for f in cloud.fields[:3])
    columns = [column.astype(np.float64) for column in (x, y, z)]
    for out, row, offset in zip((x, y, z), rotation(t), translation(t), strict=True):
        out[:] = row[0] * columns[0] + row[1] * columns[1] + row[2] * columns[2] + offset
    return data


def cloud(step, kind, count):
    size = int(kind[1])
    datatype = PointField.FLOAT32 if kind == "f4" else PointField.FLOAT64
    fields = [PointField(name=n, offset=i * size, datatype=datatype, count=1) for i, n in enumerate("xyz")]
    if step > 3 * size:
        # Otherwise the rest would be padding, which a cloud of x, y and z alone loses.
        fields.append(PointField(name="intensity", offset=3 * size, datatype=PointField.FLOAT32, count=1))
    layout = {"names": list("xyz"), "formats": [kind] * 3, "offsets": [0, size, 2 * size], "itemsize": step}
    points = np.zeros(count, np.dtype(layout))
    random = np.random.default_rng(1)
    for axis in "xyz":
        points[axis] = random.uniform(-100, 100, count)
    return PointCloud2(
        header=Header(frame_id="base"),
        height=1,
        width=count,
        fields=fields,
        point_step=step,
        row_step=step * count,
        data=array.array("B", points.tobytes()),
        is_dense=True,
    )


if __name__ == "__main__":
    serve(Types())
