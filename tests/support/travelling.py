"""The ways in which a buffer travels, and what is the same afterwards."""

import copy
import itertools
import pickle

import yaml
from making import about_z, at_ns, transform

from tf2_py import TransformException


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


def outcome(call, *arguments):
    """An answer with all of its bits, or the error."""
    try:
        return repr(call(*arguments))
    except TransformException as error:
        return type(error).__name__, str(error)


def everything(buffer, frames, times_ns):
    """What a buffer lists, and answers to every query about some frames at some times."""
    found = {
        "yaml": buffer.all_frames_as_yaml(),
        "string": buffer.all_frames_as_string(),
        "dot": buffer._allFramesAsDot(at_ns(max(times_ns))),
        "frames": buffer.frames(),
        "tree": buffer.tree(),
        "names": buffer._getFrameStrings(),
        "statistics": buffer.statistics(),
        "cache time": buffer.cache_time_ns,
    }
    for target, source in itertools.product(frames, repeat=2):
        found["latest", target, source] = outcome(buffer.get_latest_common_time, target, source)
        for time_ns in (0, *times_ns):
            time, key = at_ns(time_ns), (target, source, time_ns)
            full = target, at_ns(times_ns[0]), source, time, frames[0]
            found["lookup", key] = outcome(buffer.lookup_transform_core, target, source, time)
            found["can", key] = buffer.can_transform_core(target, source, time)
            found["full", key] = outcome(buffer.lookup_transform_full_core, *full)
            found["chain", key] = outcome(buffer._chain, *full)
    return found


def held(buffer):
    """The samples of a buffer with all that belongs to them, and what is said of the frames in them."""
    histories, infos, state = buffer.histories(), buffer.frames(), buffer.__getstate__()
    names = sorted({name for one in histories.values() for name in (one.frame, *one.parents)})
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
    assert held(arrived) == held(buffer)
