# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The ways in which a buffer travels, and what is the same afterwards."""

import copy
import pickle
import re
from pathlib import Path

from frozen_format import FrozenFile
from times_and_transforms import about_z, transform


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


HISTORIES = {  # parents, children, seconds
    "samples of one stamp": [("a", "b", 5)] * 70,
    "a former parent": [("a", "b", 1), ("c", "b", 50), ("c", "b", 51)],
    "a loop of several times": [("a", "b", 1), ("c", "b", 2), ("b", "c", 3)],
    "a former loop": [("a", "b", 1), ("b", "a", 2), ("c", "a", 50), ("c", "a", 51)],
    "slashes": [("//a", "b", 1), ("b", "//c", 1), ("c", "d", 1), ("//", "a", 1)],
}


def by_pickle(protocol):
    return lambda buffer, _folder: pickle.loads(pickle.dumps(buffer, protocol))


def out_of_band(buffer, _folder):
    buffers = []
    data = pickle.dumps(buffer, 5, buffer_callback=buffers.append)
    return pickle.loads(data, buffers=[bytes(one) for one in buffers])


def frozen(buffer, folder):
    buffer.freeze(folder / "frozen.tf2")
    return type(buffer).open(folder / "frozen.tf2")


WAYS = {
    "pickle": by_pickle(5),
    "pickle 0": by_pickle(0),
    "out of band": out_of_band,
    "deepcopy": lambda buffer, _folder: copy.deepcopy(buffer),
    "copy": lambda buffer, _folder: copy.copy(buffer),
    "frozen": frozen,
    "frozen, pickle": lambda buffer, folder: pickle.loads(pickle.dumps(frozen(buffer, folder))),
}
# These leave the attributes of a subclass behind.
BY_FILE = {"frozen", "frozen, pickle"}


def image_of(buffer):
    """All that a copy holds, as the bytes of a frozen file."""
    state = buffer.__getstate__()
    return Path(state["frozen"][0]).read_bytes() if "frozen" in state else state["image"].tobytes()


def settings(buffer):
    """Cache time and limits."""
    header = FrozenFile(image_of(buffer)).header
    return [header.cache_time_ns, header.max_frames, header.max_bytes]


def held(buffer):
    """The samples of a buffer with all that belongs to them, and what is said of the frames in them."""
    histories, infos = buffer.histories(), buffer.frames()
    names = sorted({name for one in histories.values() for name in (one.frame, *one.parents)})
    found = {
        "frames": {name: infos[name] for name in names},
        "yaml": sorted(re.split(r"\n(?=\S)", buffer.all_frames_as_yaml().rstrip())),  # in the order of names
        "settings": settings(buffer),
    }
    for name, one in histories.items():
        arrays = (one.stamps_ns, one.translations, one.rotations)
        found["history", name] = (one.static, one.parents.tolist(), *[array.tobytes() for array in arrays])
    return found


def everything(buffer):
    """The same, and all names and counts."""
    return held(buffer) | {"names": buffer._getFrameStrings(), "statistics": buffer.statistics()}


def check_copy(arrived, buffer):
    """A copy has a buffer's samples and what belongs to them; its answers: test_buffer_beside_model.py."""
    arrived._self_check()
    assert held(arrived) == held(buffer)
