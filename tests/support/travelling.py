"""The ways in which a buffer travels, and what is the same afterwards."""

import copy
import itertools
import pickle
import struct

import yaml
from making import S, about_z, at_ns, transform, translation

from tf2_py import TransformException

# What `filled` knows, and when.
FRAMES = ("map", "odom", "base", "camera", "nowhere")
TIMES_NS = (S, 2 * S, 2 * S + 1, 5 * S // 2, 9 * S)


def filled(buffer):
    """With late, duplicate, reparented, static and refused transforms, and names without data."""
    for seconds in (3, 1, 2, 2.5, 2, 4):
        buffer.set_transform(
            transform("map", "odom", seconds, (seconds, 0.1, -0.0), about_z(seconds)), "slam"
        )
    buffer.set_transform(transform("map", "odom", 2, (9, 9, 9)), "other")
    buffer.set_transform(transform("odom", "base", 2, (0.3, 0, 0), about_z(0.1)), "ekf")
    buffer.set_transform(transform("map", "base", 3, (0.7, 0, 0), about_z(3)), "ekf")
    buffer.set_transform_static(transform("base", "camera", 7, (0, 0, 1.1), (0.1, 0.2, 0.3, 0.4)), "")
    buffer.set_transform_static(transform("base", "λ mast", 0), "mount")
    buffer.set_transform(transform("map", "map", 1), "wrong")
    buffer.set_transform(transform("map", "late", 50), "slow")
    buffer.set_transform(transform("other map", "late", 1), "slow")
    return buffer


def by_pickle(protocol):
    return lambda buffer, _folder: pickle.loads(pickle.dumps(buffer, protocol))


def out_of_band(buffer, _folder):
    buffers = []
    data = pickle.dumps(buffer, 5, buffer_callback=buffers.append)
    return pickle.loads(data, buffers=[bytes(one) for one in buffers])


def by_file(buffer, folder):
    buffer.save(folder / "saved.mcap")
    return type(buffer).load(folder / "saved.mcap")


WAYS = {
    "pickle": by_pickle(5),
    "pickle 0": by_pickle(0),
    "out of band": out_of_band,
    "deepcopy": lambda buffer, _folder: copy.deepcopy(buffer),
    "copy": lambda buffer, _folder: copy.copy(buffer),
    "file": by_file,
}


def bits(message):
    """All of a TransformStamped, with its numbers as bytes: -0.0 is not 0.0."""
    q = message.transform.rotation
    return (
        message.header.stamp.sec,
        message.header.stamp.nanosec,
        message.header.frame_id,
        message.child_frame_id,
        struct.pack("7d", *translation(message), q.x, q.y, q.z, q.w),
    )


def outcome(call, *arguments):
    try:
        answer = call(*arguments)
    except TransformException as error:
        return type(error).__name__, str(error)
    return bits(answer) if hasattr(answer, "child_frame_id") else answer


def answers(buffer, frames, times_ns):
    """What a buffer answers to every query about some frames at some times."""
    found = {}
    for target, source in itertools.product(frames, repeat=2):
        found["latest", target, source] = str(outcome(buffer.get_latest_common_time, target, source))
        for time_ns in (0, *times_ns):
            time = at_ns(time_ns)
            key = target, source, time_ns
            found["lookup", key] = outcome(buffer.lookup_transform_core, target, source, time)
            found["can", key] = buffer.can_transform_core(target, source, time)
            found["full", key] = outcome(
                buffer.lookup_transform_full_core, target, at_ns(times_ns[0]), source, time, frames[0]
            )
            found["chain", key] = outcome(buffer._chain, target, time, source, time, frames[0])
    return found


def everything(buffer, frames, times_ns):
    """The same, and what a buffer lists."""
    return answers(buffer, frames, times_ns) | {
        "yaml": buffer.all_frames_as_yaml(),
        "string": buffer.all_frames_as_string(),
        "dot": buffer._allFramesAsDot(at_ns(max(times_ns))),
        "frames": buffer.frames(),
        "tree": buffer.tree(),
        "names": buffer._getFrameStrings(),
        "statistics": buffer.statistics(),
        "cache time": buffer.cache_time_ns,
    }


def named_by_samples(buffer):
    """The names of all frames and parents of samples."""
    return sorted({name for one in buffer.histories().values() for name in (one.frame, *one.parents)})


def held(buffer, names):
    """The samples of a buffer with all that belongs to them; `names` are those in them."""
    histories, infos, state = buffer.histories(), buffer.frames(), buffer.__getstate__()
    found = {
        "frames": {name: infos[name] for name in names},
        "yaml": yaml.safe_load(buffer.all_frames_as_yaml()),
        "settings": [state[key] for key in ("cache_time_ns", "max_frames", "max_bytes")],
    }
    for name, one in histories.items():
        arrays = (one.stamps_ns, one.translations, one.rotations)
        found["history", name] = (one.static, one.parents.tolist(), *[array.tobytes() for array in arrays])
    return found


def check_copy(arrived, buffer):
    """A copy has the samples of a buffer and what belongs to them; test_model.py holds its answers."""
    arrived._self_check()
    names = named_by_samples(buffer)
    assert held(arrived, names) == held(buffer, names)
