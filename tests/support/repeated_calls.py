"""Calls of a BufferCore that leave nothing behind, however often; the first word names the method."""

import pickle
import types

from making import at, transform
from rclpy.duration import Duration
from rclpy.serialization import serialize_message

from tf2_msgs.msg import TFMessage


def fill(buffer):
    buffer.set_transform(transform("map", "odom", 1), "x")
    buffer.set_transform(transform("odom", "base", 1), "x")


def raising(call, *args):
    def action():
        try:
            call(*args)
        except Exception:
            return
        raise AssertionError("it did not raise")

    return action


def actions(buffer):
    message = transform("map", "odom", 1.25)
    duck = types.SimpleNamespace(header=message.header, child_frame_id="duck", transform=message.transform)
    data = serialize_message(TFMessage(transforms=[message]))
    return {
        "set_transform": lambda: buffer.set_transform(message, "x"),
        "set_transform of a duck": lambda: buffer.set_transform(duck, "x"),
        "set_transform_static": lambda: buffer.set_transform_static(transform("odom", "plate"), "x"),
        "set_transforms": lambda: buffer.set_transforms([message, message], "x"),
        "set_transforms_cdr": lambda: buffer.set_transforms_cdr(data, "x"),
        "lookup_transform_core": lambda: buffer.lookup_transform_core("map", "base", at(1)),
        "lookup_transform_full_core": lambda: buffer.lookup_transform_full_core(
            "map", at(1), "base", at(1), "odom"
        ),
        "can_transform_core": lambda: buffer.can_transform_core("map", "base", at(5)),
        "get_latest_common_time": lambda: buffer.get_latest_common_time("map", "base"),
        "lookupVelocityCore": lambda: buffer.lookupVelocityCore("base", "map", at(1), Duration(seconds=0)),
        "all_frames_as_yaml": buffer.all_frames_as_yaml,
        "_chain": lambda: buffer._chain("map", at(1), "base", at(1), "odom"),
        "_getFrameStrings": buffer._getFrameStrings,
        "_pending_waits": lambda: (buffer._wait("map", "base", at(5)), buffer._pending_waits()),
        "statistics": buffer.statistics,
        "__reduce__ of pickle": lambda: pickle.loads(pickle.dumps(buffer)),
    }


def failures(buffer):
    data = b"\0\1\0\0" + b"\xff" * 40
    return {
        "lookup_transform_core of no frame": raising(buffer.lookup_transform_core, "map", "nowhere", at(1)),
        "lookup_transform_core of no time": raising(buffer.lookup_transform_core, "map", "base", at(5)),
        "lookup_transform_core of no text": raising(buffer.lookup_transform_core, "map", b"base", at(5)),
        "set_transforms of no transform": raising(buffer.set_transforms, [transform("a", "b"), 1], "x"),
        "__setstate__ of no state": raising(
            buffer.__setstate__, buffer.__getstate__() | {"parent_names": ["NO_PARENT"] * 9}
        ),
        "set_transforms_cdr of no message": raising(buffer.set_transforms_cdr, data, "x"),
    }
