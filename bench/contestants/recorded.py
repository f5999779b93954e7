"""
Owns recordings: writing those that are measured, and the calls of libraries that read them.

`python recorded.py NAME` serves one of `LIBRARIES`. Another interpreter imports this file, too.
"""

import bisect
import math
import struct
import sys

from serving import Contestant, Tree, serve

TOPIC, TYPE = "/tf", "tf2_msgs/msg/TFMessage"
S = 1_000_000_000
ENCAPSULATION = b"\x00\x01\x00\x00"  # CDR, little endian


class Writer(Contestant):
    def order_write(self, tree, path, compression, per_message, count):
        """Write the first transforms of a tree's file into a bare .mcap; how many they are."""
        from mcap.writer import CompressionType
        from mcap.writer import Writer as McapWriter
        from rosbags.typesys import Stores, get_typestore

        text, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(TYPE, ros_version=2)
        with open(path, "wb") as file:
            writer = McapWriter(file, compression=CompressionType[compression.upper()])
            writer.start("ros2", "bench")
            schema = writer.register_schema(TYPE, "ros2msg", text.encode())
            channel = writer.register_channel(TOPIC, "cdr", schema)
            messages = count // per_message
            for stamp_ns, data in serialised(Tree(tree), per_message, messages):
                writer.add_message(channel, stamp_ns, data, stamp_ns)
            writer.finish()
        return {"transforms": messages * per_message}


def serialised(tree, per_message, count):
    """(newest stamp, CDR) of so many TFMessages, of so many transforms each."""
    shapes = {}
    records = tree.records()
    for _ in range(count):
        parts = [ENCAPSULATION + struct.pack("<I", per_message)]
        for _ in range(per_message):
            child, parent, _, stamp_ns, pose = next(records)
            key = child, parent, len(parts) == 1
            if key not in shapes:
                shapes[key] = shape_of(*key)
            layout, names = shapes[key]
            parts.append(layout.pack(stamp_ns // S, stamp_ns % S, names, *pose))
        yield stamp_ns, b"".join(parts)


def shape_of(child, parent, is_first):
    """The layout of a TransformStamped between stamp and pose: both names, and the padding."""
    start = 4 if is_first else 0  # behind the encapsulation, of 8 bytes
    names = struct.pack("<I", len(parent) + 1) + parent.encode() + b"\0"
    names += bytes(-len(names) % 4)
    names += struct.pack("<I", len(child) + 1) + child.encode() + b"\0"
    names += bytes(-(start + 8 + len(names)) % 8)
    return struct.Struct(f"<iI{len(names)}s7d"), names


def messages_by_rosbags(path):
    """Each message of a recording as an object of rosbags'."""
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            yield store.deserialize_cdr(data, connection.msgtype)


def messages_by_mcap(path):
    """The same by the libraries mcap and mcap-ros2-support."""
    from mcap_ros2.reader import read_ros2_messages

    for message in read_ros2_messages(path):
        yield message.ros_msg


def records_of(messages):
    """As of :meth:`serving.Tree.records`."""
    for message in messages:
        for transform in message.transforms:
            stamp, t, q = (
                transform.header.stamp,
                transform.transform.translation,
                transform.transform.rotation,
            )
            yield (
                transform.child_frame_id,
                transform.header.frame_id,
                False,
                stamp.sec * S + stamp.nanosec,
                (t.x, t.y, t.z, q.x, q.y, q.z, q.w),
            )


class Raw(Contestant):
    """rosbags alone: raw messages are handed out, and dropped."""

    def load_recording(self, path):
        from rosbags.rosbag2 import Reader

        with Reader(path) as reader:
            for _ in reader.messages():
                pass


class Lists(Contestant):
    """What a user writes without tf2: lists of stamps and poses per frame; bisection, and interpolation."""

    messages = staticmethod(messages_by_rosbags)

    def load_recording(self, path):
        self.buffer = {}
        for child, parent, _, stamp_ns, pose in records_of(self.messages(path)):
            history = self.buffer.get(child)
            if history is None:
                history = self.buffer[child] = (parent, [], [])
            history[1].append(stamp_ns)
            history[2].append(pose)

    def calls(self, way, queries):
        return self.look_up, queries

    def numbers(self, answer):
        return answer

    def look_up(self, target, source, time_ns):
        up, down = self.path(source), self.path(target)
        while up and down and up[-1] == down[-1]:  # above the lowest common ancestor
            up.pop()
            down.pop()
        return compose(inverse(self.climb(down, time_ns)), self.climb(up, time_ns))

    def path(self, frame):
        path = []
        while frame in self.buffer:
            path.append(frame)
            frame = self.buffer[frame][0]
        return path

    def climb(self, path, time_ns):
        pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        for frame in path:
            pose = compose(self.pose_at(frame, time_ns), pose)
        return pose

    def pose_at(self, frame, time_ns):
        _, stamps, poses = self.buffer[frame]
        after = bisect.bisect_left(stamps, time_ns)
        if stamps[after] == time_ns:
            return poses[after]
        before_ns = stamps[after - 1]
        ratio = (time_ns - before_ns) / (stamps[after] - before_ns)
        return between(poses[after - 1], poses[after], ratio)


class ByMcap(Lists):
    messages = staticmethod(messages_by_mcap)


def between(a, b, ratio):
    cosine = sum(a[i] * b[i] for i in (3, 4, 5, 6))
    sign = -1.0 if cosine < 0.0 else 1.0
    angle = math.acos(min(1.0, abs(cosine)))
    if angle < 1e-6:
        p, q = 1.0 - ratio, ratio
    else:
        p, q = math.sin((1.0 - ratio) * angle) / math.sin(angle), math.sin(ratio * angle) / math.sin(angle)
    q *= sign
    return (
        *(a[i] + ratio * (b[i] - a[i]) for i in (0, 1, 2)),
        *(p * a[i] + q * b[i] for i in (3, 4, 5, 6)),
    )


def turn(rotation, vector):
    (x, y, z, w), (a, b, c) = rotation, vector
    u, v, t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u


def compose(a, b):
    x, y, z = turn(a[3:], b[:3])
    ax, ay, az, aw = a[3:]
    bx, by, bz, bw = b[3:]
    return (
        a[0] + x,
        a[1] + y,
        a[2] + z,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def inverse(pose):
    x, y, z, qx, qy, qz, qw = pose
    back = (-qx, -qy, -qz, qw)
    return (*turn(back, (-x, -y, -z)), *back)


LIBRARIES = {"writer": Writer, "rosbags": Raw, "rosbags + lists": Lists, "mcap + lists": ByMcap}

if __name__ == "__main__":
    serve(LIBRARIES[sys.argv[1]]())
