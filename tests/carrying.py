"""Makes the messages that are carried from frame to frame, and the arithmetic to judge the result by."""

import math

import numpy as np
from geometry_msgs.msg import (
    Accel,
    AccelStamped,
    Point,
    Point32,
    PointStamped,
    Polygon,
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    Twist,
    TwistStamped,
    TwistWithCovariance,
    Vector3,
    Vector3Stamped,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)
from hypothesis import settings
from hypothesis import strategies as st
from making import transform
from nav_msgs.msg import Odometry, Path
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, MagneticField
from std_msgs.msg import Header

# A busy machine is no reason to fail.
settings.register_profile("carrying", deadline=None)
settings.load_profile("carrying")

coordinates = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 1e-300, -5e-324, 1.0, 0.1])
vectors = st.tuples(coordinates, coordinates, coordinates)

HALF = math.sqrt(0.5)
AWKWARD_TURNS = [
    (0.0, 0.0, 0.0, 1.0),
    (0.0, 0.0, 0.0, -1.0),
    (1.0, 0.0, 0.0, 0.0),  # half turns: w is zero
    (0.0, -1.0, 0.0, 0.0),
    (0.0, 0.0, 1.0, -0.0),
    (HALF, HALF, 0.0, 1e-17),
    (0.0, 0.0, HALF, HALF),
    (-0.5, -0.5, -0.5, -0.5),
    (1e-9, 0.0, 0.0, 1.0),
]
_parts_of_turns = st.floats(-1.0, 1.0)
_any_turn = st.tuples(_parts_of_turns, _parts_of_turns, _parts_of_turns, _parts_of_turns).filter(
    lambda q: math.hypot(*q) > 1e-3
)
_lengths = st.sampled_from([1.0, 2.0, 1e-3])
# Quaternions x y z w that stand for rotations, not all of length one.
turns = st.sampled_from(AWKWARD_TURNS) | st.builds(
    lambda q, length: tuple(length * x for x in q), _any_turn, _lengths
)
transforms = st.builds(lambda xyz, xyzw: transform("map", "base", 7.25, xyz, xyzw), vectors, turns)


def xyz(m):
    return np.array([m.x, m.y, m.z])


def xyzw(m):
    return np.array([m.x, m.y, m.z, m.w])


def turn(q):
    """SciPy's rotation for a quaternion of any length, message or tuple."""
    q = np.array(q if isinstance(q, tuple) else xyzw(q))
    return Rotation.from_quat(q / np.linalg.norm(q))


def matrix(t):
    """The 4x4 matrix of a transform, by SciPy."""
    m = np.eye(4)
    m[:3, :3] = turn(t.transform.rotation).as_matrix()
    m[:3, 3] = xyz(t.transform.translation)
    return m


def carried(points, t):
    """An (n, 3) array of points in the target frame of a transform."""
    return points @ matrix(t)[:3, :3].T + matrix(t)[:3, 3]


def inverse(t):
    back = turn(t.transform.rotation).inv()
    return transform(
        t.child_frame_id, t.header.frame_id, 7.25, -back.apply(xyz(t.transform.translation)), back.as_quat()
    )


def covariance_carried(covariance, t):
    """A 6x6 covariance in the target frame of a transform, as one product of 6x6 matrices."""
    both = np.kron(np.eye(2), turn(t.transform.rotation).as_matrix())
    return both @ np.reshape(covariance, (6, 6)) @ both.T


class Maker:
    """Makes random messages; quaternions have length one and w >= 0, so that they compare."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def floats(self, count):
        return self.random.uniform(-10, 10, count).tolist()

    def header(self):
        return Header(frame_id="base")

    def vector(self, cls=Vector3):
        x, y, z = self.floats(3)
        return cls(x=x, y=y, z=z)

    def quaternion(self):
        q = self.random.normal(size=4)
        q *= np.sign(q[3]) / np.linalg.norm(q)
        return Quaternion(**dict(zip("xyzw", q.tolist(), strict=True)))

    def covariance(self, side=6):
        half = self.random.normal(size=(side, side))
        return (half @ half.T).ravel()

    def pose(self):
        return Pose(position=self.vector(Point), orientation=self.quaternion())

    def pose_with_covariance(self):
        return PoseWithCovariance(pose=self.pose(), covariance=self.covariance())

    def polygon(self):
        return Polygon(points=[self.vector(Point32) for _ in range(5)])

    def transform(self):
        return Transform(translation=self.vector(), rotation=self.quaternion())

    def wrench(self):
        return Wrench(force=self.vector(), torque=self.vector())

    def twist(self):
        return Twist(linear=self.vector(), angular=self.vector())

    def path(self):
        poses = [PoseStamped(header=self.header(), pose=self.pose()) for _ in range(4)]
        for i, pose in enumerate(poses):
            pose.header.stamp.sec = 100 + i
        return Path(header=self.header(), poses=poses)

    def odometry(self):
        twist = TwistWithCovariance(twist=self.twist(), covariance=self.covariance())
        return Odometry(
            header=self.header(), child_frame_id="wheels", pose=self.pose_with_covariance(), twist=twist
        )

    def imu(self):
        return Imu(
            header=self.header(),
            orientation=self.quaternion(),
            orientation_covariance=self.covariance(3),
            angular_velocity=self.vector(),
            angular_velocity_covariance=self.covariance(3),
            linear_acceleration=self.vector(),
            linear_acceleration_covariance=self.covariance(3),
        )

    def magnetic_field(self):
        return MagneticField(
            header=self.header(),
            magnetic_field=self.vector(),
            magnetic_field_covariance=self.covariance(3),
        )

    def message(self, cls):
        plain = {
            Point: lambda: self.vector(Point),
            Point32: lambda: self.vector(Point32),
            Vector3: self.vector,
            Quaternion: self.quaternion,
            Pose: self.pose,
            PoseWithCovariance: self.pose_with_covariance,
            Polygon: self.polygon,
            Transform: self.transform,
            Wrench: self.wrench,
            Path: self.path,
            Odometry: self.odometry,
            Imu: self.imu,
            MagneticField: self.magnetic_field,
        }
        contents = {
            PointStamped: lambda: {"point": self.vector(Point)},
            Vector3Stamped: lambda: {"vector": self.vector()},
            QuaternionStamped: lambda: {"quaternion": self.quaternion()},
            PoseStamped: lambda: {"pose": self.pose()},
            PoseWithCovarianceStamped: lambda: {"pose": self.pose_with_covariance()},
            PolygonStamped: lambda: {"polygon": self.polygon()},
            PoseArray: lambda: {"poses": [self.pose() for _ in range(5)]},
            TransformStamped: lambda: {"transform": self.transform(), "child_frame_id": "tool"},
            WrenchStamped: lambda: {"wrench": self.wrench()},
            TwistStamped: lambda: {"twist": self.twist()},
            AccelStamped: lambda: {"accel": Accel(linear=self.vector(), angular=self.vector())},
            VelocityStamped: lambda: {
                "velocity": self.twist(),
                "body_frame_id": "body",
                "reference_frame_id": "odom",
            },
        }
        return plain[cls]() if cls in plain else cls(header=self.header(), **contents[cls]())


UNSTAMPED = [
    Point,
    Point32,
    Vector3,
    Quaternion,
    Pose,
    PoseWithCovariance,
    Polygon,
    Transform,
    Wrench,
]
STAMPED = [
    PointStamped,
    Vector3Stamped,
    QuaternionStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    PolygonStamped,
    PoseArray,
    TransformStamped,
    WrenchStamped,
    TwistStamped,
    AccelStamped,
    VelocityStamped,
    Path,
    Odometry,
    Imu,
    MagneticField,
]
ALL = UNSTAMPED + STAMPED


def numbers(m):
    """Every number in a message outside its headers, in order."""
    if isinstance(m, Header | str):
        return []
    if isinstance(m, int | float):
        return [m]
    parts = m if isinstance(m, list | np.ndarray) else [getattr(m, f) for f in m.get_fields_and_field_types()]
    return [number for part in parts for number in numbers(part)]
