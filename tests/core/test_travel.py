"""Buffers travel: by pickle, as copies, and as files, with everything that they hold."""

import importlib.util
import io
import multiprocessing
import operator
import os
import pickle
import resource
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from making import S, at, transform, translation
from processes import DEADLINE_S
from rclpy.duration import Duration
from sources import PACKAGES
from travelling import FRAMES, TIMES_NS, WAYS, everything, filled, out_of_band

from tf2_py import BufferCore, LookupException
from tf2_ros import Buffer, TransformListener

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer():
    return filled(BufferCore(Duration(seconds=20), max_frames=10, max_bytes=50_000, max_waiters=7))


@pytest.fixture(params=WAYS)
def travel(request, tmp_path):
    return lambda buffer: WAYS[request.param](buffer, tmp_path)


def test_a_buffer_arrives_as_it_was(travel, buffer):
    arrived = travel(buffer)
    assert everything(arrived, FRAMES, TIMES_NS) == everything(buffer, FRAMES, TIMES_NS)
    assert repr(arrived) == repr(buffer)
    arrived._self_check()


def test_it_takes_and_refuses_the_same_transforms_afterwards(travel, buffer):
    arrived = travel(buffer)
    for i in range(2000):  # also until the memory is full
        late = transform("map", f"frame {i % 11}", 5 + i * 1e-3 * (-1) ** i, (i, 0, 0))
        buffer.set_transform(late, "x")
        arrived.set_transform(late, "x")
        assert arrived.statistics() == buffer.statistics()
    assert (
        buffer.statistics()["refused"]["too_many_bytes"] and buffer.statistics()["refused"]["too_many_frames"]
    )
    assert everything(arrived, FRAMES, TIMES_NS) == everything(buffer, FRAMES, TIMES_NS)


def test_an_empty_buffer_arrives(travel):
    arrived = travel(BufferCore(Duration(seconds=0)))
    assert (arrived.cache_time_ns, arrived.frames()) == (0, {})
    arrived._self_check()


def test_a_cleared_buffer_keeps_its_names_and_static_transforms(travel, buffer):
    buffer.clear()
    assert everything(travel(buffer), FRAMES, TIMES_NS) == everything(buffer, FRAMES, TIMES_NS)


def test_a_loop_is_the_same_loop(travel):
    buffer = BufferCore()
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a"), ("d", "e")):
        buffer.set_transform(transform(parent, child, 1), "x")
    arrived = travel(buffer)
    assert everything(arrived, "abcde", [S]) == everything(buffer, "abcde", [S])
    with pytest.raises(LookupException, match="loop"):
        arrived.lookup_transform_core("d", "a", at(1))


def test_a_copy_is_independent(travel, buffer):
    arrived = travel(buffer)
    before = everything(buffer, FRAMES, TIMES_NS)
    arrived.clear()
    arrived.set_transform(transform("map", "new", 1), "x")
    assert everything(buffer, FRAMES, TIMES_NS) == before


def test_a_buffer_made_by_new_alone_arrives(travel):
    for kind in (BufferCore, Buffer):
        arrived = travel(kind.__new__(kind))
        assert type(arrived) is kind
        arrived.set_transform(transform("a", "b", 1), "x")
        assert "b" in arrived


def test_arrays_of_an_arrived_buffer_can_be_written(travel, buffer):
    translations, rotations = travel(buffer).lookup_transforms("map", "odom", [S, 2 * S])
    translations[0] = rotations[0] = 0


# What a program's own classes add.


class Robot(Buffer):
    """With another constructor, attributes and a slot."""

    __slots__ = ("slotted",)

    def __init__(self, name, *, size):
        super().__init__()
        self.name, self.size, self.itself = name, [size], self
        self.slotted = "yes"


def test_attributes_of_a_subclass_travel_and_its_init_is_not_called(buffer, tmp_path):
    robot = Robot("r1", size=3)
    robot.set_transform(transform("map", "odom", 1, (1, 2, 3)), "x")
    for name, travel in WAYS.items():
        arrived = travel(robot, tmp_path)
        assert type(arrived) is Robot
        assert translation(arrived.lookup_transform("map", "odom", at(1))) == (1, 2, 3)
        if name == "file":
            assert not hasattr(arrived, "name")
            continue
        assert (arrived.name, arrived.size, arrived.slotted) == ("r1", [3], "yes")
        assert arrived.itself is (robot if name == "copy" else arrived)
        assert (arrived.size is robot.size) == (name == "copy")


class Told(Buffer):
    """With a state of its own."""

    def __getstate__(self):
        return super().__getstate__() | {"told": 7}

    def __setstate__(self, state):
        self.told = state.pop("told")
        super().__setstate__(state)


def test_a_subclass_may_have_a_state_of_its_own():
    assert pickle.loads(pickle.dumps(Told())).told == 7


def test_a_node_does_not_travel(node, tmp_path):
    buffer = Buffer(node=node)
    buffer.name = "r1"
    listener = TransformListener(buffer, node)
    buffer.set_transform(transform("map", "odom", 1), "x")
    for name, travel in WAYS.items():
        arrived = travel(buffer, tmp_path)
        assert hasattr(arrived, "name") == (name != "file")
        assert arrived.srv is None and arrived.clock is not buffer.clock
        assert arrived.can_transform("map", "odom", at(1), timeout=0.001)
        assert not arrived.can_transform("map", "odom", at(9), timeout=0.001)
        assert arrived.wait_for_transform_async("map", "odom", at(1)).done()
    listener.unregister()


def test_another_process_gets_a_buffer(buffer):
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        sent = pool.submit(operator.methodcaller("tree"), filled(Buffer()))
        assert sent.result(DEADLINE_S) == filled(Buffer()).tree()


def test_a_wait_goes_on_when_its_buffer_gets_a_state(buffer):
    answers = []
    waiting = BufferCore()
    wait = waiting._wait("map", "odom", at(2), notify=answers.append)
    assert not answers
    waiting.__setstate__(buffer.__getstate__())
    assert [translation(answer) for answer in answers] == [translation(wait.answer)]
    waiting._self_check()
    assert buffer.__getstate__().keys() == waiting.__getstate__().keys()


def test_a_pickle_is_of_one_moment():
    buffer = BufferCore()
    end = threading.Event()

    def insert():
        i = 0
        while not end.is_set():
            i += 1
            buffer.set_transforms([transform("map", f"f{k}", ns=i) for k in range(10)], "x")

    thread = threading.Thread(target=insert)
    thread.start()
    try:
        while buffer.statistics()["samples"] < 5000:
            arrived = out_of_band(buffer, None)
            arrived._self_check()
            counts = [info.count for name, info in arrived.frames().items() if name != "map"]
            assert sorted(counts, reverse=True) == counts and (not counts or counts[0] - counts[-1] <= 1)
    finally:
        end.set()
        thread.join()


# What a pickle is.


class NotesNames(pickle.Unpickler):
    """Notes the module of every callable and class that a pickle names."""

    def __init__(self, data):
        super().__init__(io.BytesIO(data))
        self.modules = set()

    def find_class(self, module, name):
        self.modules.add(module.partition(".")[0])
        return super().find_class(module, name)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_pickles_name_only_our_own_and_numpys_callables(protocol):
    unpickler = NotesNames(pickle.dumps(filled(Buffer()), protocol))
    unpickler.load()
    # Python itself writes bytes by a codec, where its protocol has none.
    assert unpickler.modules == {"numpy", "tf2_py", "tf2_ros"} | ({"_codecs"} if protocol < 3 else set())


def test_arrays_are_not_copied_into_a_pickle_of_protocol_5():
    buffer = BufferCore(Duration(seconds=10_000))
    for i in range(1000):
        buffer.set_transform(transform("map", "odom", i), "x")
    buffers = []
    data = pickle.dumps(buffer, 5, buffer_callback=buffers.append)
    assert len(data) < 1500
    assert sum(len(one.raw()) for one in buffers) >= 1000 * (8 + 56 + 4)
    # Read-only memory is as good.
    arrived = pickle.loads(data, buffers=[one.raw().toreadonly() for one in buffers])
    assert arrived.frames() == buffer.frames()


def test_arrays_in_another_order_of_bytes_or_memory_are_converted(buffer):
    state = buffer.__getstate__()
    for key in ("frames", "stamps", "transforms", "parents"):
        array = state[key]
        state[key] = np.asfortranarray(array.astype(array.dtype.newbyteorder()))
    arrived = BufferCore()
    arrived.__setstate__(state)
    assert everything(arrived, FRAMES, TIMES_NS) == everything(buffer, FRAMES, TIMES_NS)


# What is refused.


def changed(key, change):
    """A change of one part of a state, in place for arrays."""

    def apply(state):
        new = change(state[key])
        state[key] = state[key] if new is None else new

    return apply


def put(key, index, value):
    return changed(key, lambda array: array.__setitem__(index, value))


SPOILED = {
    "of version 2": changed("version", lambda _: 2),
    "version is not an int": changed("version", lambda _: 1.0),
    "lacks, or has too many: 'stamps'": lambda state: state.pop("stamps"),
    "lacks, or has too many: 'more'": lambda state: state.update(more=1),
    "cache_time_ns is -1": changed("cache_time_ns", lambda _: -1),
    "cache_time_ns is too large": changed("cache_time_ns", lambda _: 1 << 200),
    "max_frames is 0": changed("max_frames", lambda _: 0),
    "max_bytes is not an int but bool": changed("max_bytes", lambda _: True),
    "more names than frames, or than the limit": changed("max_frames", lambda _: 1),
    "ever_looped is not a bool": changed("ever_looped", lambda _: 0),
    "taken is -1": changed("taken", lambda _: -1),
    "refused is not a tuple": changed("refused", lambda value: value[1:]),
    "refused is not an int": changed("refused", lambda value: ("1", *value[1:])),
    "names is not bytes": changed("names", bytes.decode),
    "names is not UTF-8": changed("names", lambda names: b"\xff" + names),
    "does not end with a NUL": changed("names", lambda names: names[:-1]),
    "name of a frame is empty": changed("names", lambda names: b"\0" + names),
    "a name occurs twice": changed("names", lambda names: names.replace(b"odom", b"map")),
    "or is a reserved one": changed("names", lambda names: names.replace(b"odom", b"NO_PARENT")),
    "more frames than names": changed("names", lambda names: names.removesuffix(b"other map\0")),
    "more names than frames": changed("names", lambda names: names + b"more\0"),
    "an authority that is not a name": changed("authorities", lambda _: b""),
    "frames is not an array but list": changed("frames", np.ndarray.tolist),
    "frames is of dtype int64, not uint32": changed("frames", lambda array: array.astype("int64")),
    "frames is of shape": changed("frames", np.ravel),
    "stamps is of dtype object": changed("stamps", lambda array: array.astype(object)),
    "transforms is of shape": changed("transforms", lambda array: array[:, :6]),
    "parents is of shape": changed("parents", lambda array: array[1:]),
    "value that has no meaning": put("frames", (0, 0), 3),
    "frame has more samples than its capacity": put("frames", (0, 1), 1 << 30),
    "or one that is too large": put("frames", (0, 4), 0xFFFFFFFF),
    "capacity that is none of its kind": put("frames", (1, 4), 8),
    "a dynamic history of less than the first capacity": put("frames", (2, 4), 3),
    "more samples than there are stamps": put("frames", (0, slice(1, 5, 3)), 1000),
    "more stamps than samples": put("frames", (0, 1), 1),
    "parent that is not marked as one": put("frames", (1, 3), 0),
    "a stamp that no message holds": put("stamps", 0, -1),
    "stamps out of order": put("stamps", 0, 9 * S),
    "a translation that is not finite": put("transforms", (0, 0), np.nan),
    "a rotation that is not normalised": put("transforms", (0, 6), np.inf),
    "a rotation without the canonical sign": changed(
        "transforms", lambda array: array.__setitem__((slice(0, 1), slice(3, 7)), -array[:1, 3:])
    ),
    "a parent that is not a frame": put("parents", 0, 0xFFFFFFFF),
    "a sample without parent": put("parents", 0, 0),
    "a frame that is its own parent": put("parents", 0, 1),
    "its attributes are not a dict": changed("attributes", lambda _: []),
    "has no attributes of its own": changed("attributes", lambda _: {"a": 1}),
}


@pytest.mark.parametrize("why", SPOILED)
def test_a_spoiled_state_is_refused_and_changes_nothing(why, buffer):
    state = buffer.__getstate__()
    SPOILED[why](state)
    arriving = filled(BufferCore())
    before = everything(arriving, FRAMES, TIMES_NS)
    with pytest.raises(ValueError, match=f"not the state of a buffer.*{why}|^{why}"):
        arriving.__setstate__(state)
    assert everything(arriving, FRAMES, TIMES_NS) == before


@pytest.mark.parametrize("number", range(7))
@pytest.mark.parametrize("sample", [0, -1])
def test_every_number_of_every_sample_is_checked(number, sample, buffer):
    state = buffer.__getstate__()
    state["transforms"][sample, number] += np.inf if number < 3 else 0.5
    with pytest.raises(
        ValueError, match="a translation that is not finite|a rotation that is not normalised"
    ):
        BufferCore().__setstate__(state)


def test_the_first_values_beyond_what_a_state_may_hold_are_refused(buffer):
    def refusal(key, index, value):
        state = buffer.__getstate__()
        state[key][index] = value
        with pytest.raises(ValueError) as refused:
            BufferCore().__setstate__(state)
        return str(refused.value)

    state = buffer.__getstate__()
    newest = state["frames"][0, 1] - 1
    assert "no message holds" in refusal("stamps", newest, 2**31 * S)
    assert "a parent that is not a frame" in refusal("parents", 0, len(state["frames"]) + 1)
    assert "less than the first capacity" in refusal("frames", (2, 4), 7)
    names = state["authorities"].count(b"\0")
    assert "an authority that is not a name" in refusal("frames", (0, 2), names + 1)


def test_the_last_values_that_a_state_may_hold_are_taken(buffer):
    state = buffer.__getstate__()
    state["stamps"][state["frames"][0, 1] - 1] = 2**31 * S - 1
    state["frames"][0, 2] = state["authorities"].count(b"\0")
    arrived = BufferCore()
    arrived.__setstate__(state)
    arrived._self_check()
    assert arrived.get_latest_common_time("map", "odom").nanoseconds == 2**31 * S - 1


def test_a_static_frame_without_its_sample_is_refused(buffer):
    state = buffer.__getstate__()
    at = int(state["frames"][:3, 1].sum())
    state["frames"][3, 1] = 0
    for key in ("stamps", "transforms", "parents"):
        state[key] = np.delete(state[key], at, axis=0)
    with pytest.raises(ValueError, match="a static history without its one sample"):
        BufferCore().__setstate__(state)


def test_what_is_no_state_is_refused():
    for state in (None, [], "state", {}, {"version": None}):
        with pytest.raises(ValueError, match="not the state of a buffer"):
            BufferCore().__setstate__(state)


def test_a_loop_that_the_state_denies_is_refused():
    buffer = BufferCore()
    for ns, parent, child in ((1, "a", "b"), (2, "c", "b"), (3, "b", "c")):
        buffer.set_transform(transform(parent, child, ns=ns), "x")
    state = buffer.__getstate__()
    assert state["ever_looped"]
    state["ever_looped"] = False
    with pytest.raises(ValueError, match="loop"):
        BufferCore().__setstate__(state)


def test_more_samples_of_one_stamp_than_any_buffer_keeps_are_refused():
    buffer = BufferCore()
    for i in range(65):
        buffer.set_transform(transform("a", "b", ns=i), "x")
    state = buffer.__getstate__()
    state["stamps"][:] = 5
    with pytest.raises(ValueError, match="too many samples of one stamp"):
        BufferCore().__setstate__(state)


def test_checking_a_state_leaves_no_memory_behind():
    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1])

    buffer = BufferCore()
    buffer.set_transforms([transform("map", f"f{i}", 1) for i in range(5000)], "x")
    state = buffer.__getstate__()
    for _ in range(10):
        buffer.__setstate__(state)
    before = resident()
    for _ in range(100):
        buffer.__setstate__(state)
    # A byte of each frame in each of these were 120 pages.
    assert resident() - before < 100


def test_a_state_that_needs_too_much_memory_changes_nothing(buffer):
    state = buffer.__getstate__()
    state["frames"][0, 4] = (1 << 31) - 1  # samples of 72 bytes
    arriving = filled(BufferCore())
    before = everything(arriving, FRAMES, TIMES_NS)
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (100 << 30, limits[1]))
    try:
        with pytest.raises(MemoryError):
            arriving.__setstate__(state)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
    assert everything(arriving, FRAMES, TIMES_NS) == before


# With ROS and without.

WITHOUT_ROS = """
import pickle
import sys
from tf2_ros import Buffer
data = open(sys.argv[1], "rb").read()
arrived = pickle.loads(data)
assert type(arrived) is Buffer
try:
    import rclpy
except ModuleNotFoundError:
    open(sys.argv[1] + ".back", "wb").write(pickle.dumps(arrived))
print(arrived.tree())
"""


def test_pickles_cross_between_programs_with_ros_and_without(tmp_path):
    buffer = filled(Buffer())
    path = tmp_path / "buffer.pickle"
    path.write_bytes(pickle.dumps(buffer))
    site = tmp_path / "site"
    site.mkdir()
    for package in (*PACKAGES, "numpy"):
        folder = Path(importlib.util.find_spec(package).origin).parent
        (site / package).symlink_to(folder)
        libraries = folder.with_name(f"{package}.libs")
        if libraries.exists():
            (site / libraries.name).symlink_to(libraries)
    # -S: without the folders of the environment, where ROS may be.
    run = subprocess.run(
        [sys.executable, "-S", "-c", WITHOUT_ROS, path],
        env=os.environ | {"PYTHONPATH": str(site), "PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        text=True,
        encoding="utf-8",
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == buffer.tree()
    arrived = pickle.loads(path.with_name("buffer.pickle.back").read_bytes())
    assert everything(arrived, FRAMES, TIMES_NS) == everything(buffer, FRAMES, TIMES_NS)
    assert arrived.can_transform("map", "odom", at(2), timeout=0.1)
