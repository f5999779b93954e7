"""Write the recordings to measure, or only read them; `python recorded.py NAME` serves one of LIBRARIES."""

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


class Raw(Contestant):
    """Only rosbags: raw messages are handed out, and dropped."""

    def load_recording(self, path):
        from rosbags.rosbag2 import Reader

        with Reader(path) as reader:
            for _ in reader.messages():
                pass


LIBRARIES = {"writer": Writer, "rosbags": Raw}

if __name__ == "__main__":
    serve(LIBRARIES[sys.argv[1]]())
