# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure recordings: loading one, looking up in it, pickling it, and several at once."""

import pickle
import struct
from pathlib import Path
from time import perf_counter_ns

from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from trees_and_queries import bushy

from tf2_ros_tools import bag

HOPS = 4
WORKERS = (1, 2)
KINDS = [(count, compression) for compression in ("NONE", "ZSTD") for count in (1, 5, 50)]
TYPE = "tf2_msgs/msg/TFMessage"
S = 1_000_000_000
ENCAPSULATION = b"\x00\x01\x00\x00"  # CDR, little endian


def recordings(rows, sizes, library):
    """Loading the transforms of a hundred frames, lookups in them, pickles."""
    tree = _tree(sizes)
    for count, compression in KINDS:
        path = _written(sizes, tree, count, compression)
        labels = {"transforms in a message": count, "compression": compression}
        for way, load in ("only rosbags", _read_raw), ("bag.load", _load):
            start = perf_counter_ns()
            library.buffer = load(path)
            rows.add(way, labels, [(perf_counter_ns() - start) / len(tree.records)])
    pairs = tree.pairs(HOPS, sizes.vector_pairs)
    labels = {"lookups": sizes.recording_lookups, "hops": HOPS}
    queries = tree.queries(pairs, tree.times("random", sizes.recording_lookups))
    rows.time_lookups(library, "core", labels, queries, sizes)
    queries = tree.vector_queries(pairs[:1], "sorted", sizes.recording_lookups)
    rows.time_lookups(library, "vector", labels, queries, sizes, per=sizes.recording_lookups)
    for way, apart in ("pickle", False), ("pickle, arrays apart", True):
        rows.add(way, {"samples": len(tree.records)}, [_time_pickle(library.buffer, apart)])


def several(rows, sizes, _):
    """Recordings per second with one and two workers: a table of each, at 10 Hz."""
    tree = _tree(sizes)
    target, source = (tree.names[frame] for frame in tree.pairs(HOPS, 1)[0])
    folder = Path(sizes.folder, "several")
    folder.mkdir()
    paths = [folder / f"{i}.mcap" for i in range(sizes.recording_files)]
    for path in paths:
        path.hardlink_to(_written(sizes, tree, 1, "NONE"))
    for workers in WORKERS:
        out = folder / f"tables-{workers}"
        start = perf_counter_ns()
        bag.map_recordings(paths, target, source, out, rate=10.0, workers=workers, progress=False)
        seconds = (perf_counter_ns() - start) / 1e9
        labels = {"recordings": len(paths), "workers": workers}
        rows.add("map_recordings", labels, [len(paths) / seconds], "/s")


def _tree(sizes):
    samples = sizes.recording_transforms // sizes.recording_frames
    return bushy("recordings", sizes.recording_frames + 1, 1.0, samples)


def _written(sizes, tree, count, compression):
    """The recording; the first round writes it."""
    path = Path(sizes.folder, f"{compression}-{count}.mcap")
    if not path.exists():
        _write(path, tree, count, compression)
    return path


def _load(path):
    return bag.load(path, progress=False)


def _read_raw(path):
    """Only rosbags: raw messages are handed out, and dropped."""
    with Reader(path) as reader:
        for _ in reader.messages():
            pass


def _time_pickle(buffer, apart):
    """ns of pickling and unpickling; `apart`: the arrays beside the pickle, and not in it."""
    arrays = []
    start = perf_counter_ns()
    data = pickle.dumps(buffer, protocol=5, buffer_callback=arrays.append if apart else None)
    copy = pickle.loads(data, buffers=arrays)
    took = perf_counter_ns() - start
    if copy.statistics()["samples"] != buffer.statistics()["samples"]:
        raise ValueError("the copy is another")
    return took


def _write(path, tree, per_message, compression):
    """Write a tree's transforms into an .mcap, so many in each message."""
    text, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(TYPE, ros_version=2)
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType[compression])
        writer.start("ros2", "bench")
        schema = writer.register_schema(TYPE, "ros2msg", text.encode())
        channel = writer.register_channel("/tf", "cdr", schema)
        for stamp_ns, data in _serialised(tree, per_message):
            writer.add_message(channel, stamp_ns, data, stamp_ns)
        writer.finish()


def _serialised(tree, per_message):
    """(newest stamp, CDR) of TFMessages of so many transforms each."""
    shapes, transforms = {}, tree.transforms()
    for _ in range(len(tree.records) // per_message):
        parts = [ENCAPSULATION + struct.pack("<I", per_message)]
        for _ in range(per_message):
            child, parent, _, stamp_ns, pose = next(transforms)
            key = child, parent, len(parts) == 1
            if key not in shapes:
                shapes[key] = _shape_of(*key)
            layout, names = shapes[key]
            parts.append(layout.pack(stamp_ns // S, stamp_ns % S, names, *pose))
        yield stamp_ns, b"".join(parts)


def _shape_of(child, parent, is_first):
    """The layout of a TransformStamped between stamp and pose: both names, and the padding."""
    start = 4 if is_first else 0  # behind the encapsulation, of 8 bytes
    names = struct.pack("<I", len(parent) + 1) + parent.encode() + b"\0"
    names += bytes(-len(names) % 4)
    names += struct.pack("<I", len(child) + 1) + child.encode() + b"\0"
    names += bytes(-(start + 8 + len(names)) % 8)
    return struct.Struct(f"<iI{len(names)}s7d"), names
