"""A buffer that is attached answers as the shared one does, after every step, and when it has left."""

import copy
import gc
import os
import pickle
import random
import struct
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from making import S, at_ns, transform
from processes import until
from rclpy.duration import Duration
from sharing import LINKS, Owner, is_sound, links, new_name, pair
from test_conformance import SCENARIOS, check_answer
from test_travel_random import FRAMES, TIMES_NS, apply, limits, silence, steps  # noqa: F401
from travelling import bits, everything, outcome

import tf2_py
from tf2_py import TransformException
from tf2_ros import Buffer, SharedBufferError
from tf2_ros._shared.names import segment_path
from tf2_ros._shared.owning import Owner as Sharer

pytestmark = pytest.mark.ours

CHANGES = {"set", "clear"}


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s["name"])
def test_answers_as_recorded(scenario):
    with pair(Duration(nanoseconds=scenario["cache_ns"])) as (owner, reader):
        for (op, *args), want in zip(scenario["ops"], scenario["want"], strict=True):
            check_answer(tf2_py, owner if op in CHANGES else reader, op, args, want)
        assert reader._is_attached
        reader._self_check()
        owner._self_check()


@settings(deadline=None, max_examples=150)
@given(limits, steps, steps)
def test_after_every_step_it_holds_what_the_owner_does_and_keeps_it_when_it_leaves(limits, before, after):
    # The first steps are taken before anybody is attached.
    owner = Buffer(Duration(nanoseconds=10), share=new_name(), **limits)
    apply(owner, before)
    reader = Buffer(Duration(nanoseconds=10), attach=owner._sharing.name, **limits)
    for step in after:
        apply(owner, [step])
        assert everything(reader, FRAMES, TIMES_NS[:2]) == everything(owner, FRAMES, TIMES_NS[:2])
        reader._self_check()
        owner._self_check()
    expected = everything(owner, FRAMES, TIMES_NS)
    assert everything(reader, FRAMES, TIMES_NS) == expected
    travelled = [pickle.loads(pickle.dumps(reader)), copy.copy(reader)]
    reader._leave()
    assert not reader._is_attached
    # Memory is counted otherwise: the copy knows the names, and not how many more there was room for.
    for buffer in (reader, *travelled):
        buffer._self_check()
        found = everything(buffer, FRAMES, TIMES_NS)
        for one in (found, expected):
            one["statistics"].pop("bytes", None)
        assert found == expected
        apply(buffer, after)
        buffer._self_check()
    owner._sharing.close()


LOOKUPS = [(target, source, ns) for target in "abc" for source in "abcd" for ns in (0, 2, 5, 11)]


@pytest.mark.parametrize("seed", range(20))
def test_a_waiter_is_told_of_every_change_that_helps_it(seed):
    # The invariant: what is pending would fail now.
    chance = random.Random(seed)
    answered = 0
    with pair(Duration(nanoseconds=10)) as (owner, _):
        reader = tf2_py.BufferCore()
        Buffer(attach=owner._sharing.name)._sharing._segment.attach(reader)  # without a thread of its own
        waiting = []
        for step in range(300):
            lookup = chance.choice(LOOKUPS)
            got = []
            waiting.append((lookup, got, reader._wait(*lookup[:2], at_ns(lookup[2]), notify=got.append)))
            what = chance.random()
            if what < 0.02:
                owner.clear()
            else:
                names = chance.sample("abcd", 2)
                insert = owner.set_transform_static if what < 0.1 else owner.set_transform
                insert(transform(*names, ns=chance.randrange(step // 20, step // 20 + 12)), "random")
            if chance.random() < 0.5:
                reader.can_transform_core("a", "b", 0)  # which catches up before the waiters are told
            if chance.random() < 0.7:
                reader._follow(0.0, [])
                for lookup, got, wait in waiting:
                    if not got and wait.answer is None:
                        assert not reader.can_transform_core(*lookup[:2], at_ns(lookup[2]))[0], (step, lookup)
                answered += sum(bool(got) for _, got, _ in waiting)
                waiting = [one for one in waiting if not one[1] and one[2].answer is None]
        reader._self_check()
    assert answered > 20


def test_many_times_in_one_call_are_of_one_state():
    with Owner() as owner:
        reader = Buffer(attach=owner.name)
        first_ns = 1000 * S
        owner.tell("run", 0, 20)
        for _ in range(300):
            try:
                newest = reader.get_latest_common_time("map", f"f{LINKS - 1}").nanoseconds
                times = np.arange(newest - S // 5, newest, S // 2000)
                places, _ = reader.lookup_transforms("map", f"f{LINKS - 1}", times)
            except TransformException:
                continue
            assert np.abs(places[:, 0] - LINKS * (times - first_ns) / S).max() < 1e-6
        assert reader._is_attached


def test_no_answer_is_made_of_two_states_however_the_owner_writes():
    # Late samples move others, each of them; the histories are long, and the owner does nothing else.
    count, step = 30000, 10**6
    stopped = threading.Event()

    def placed(ns):
        return transform("map", "f", ns=ns, xyz=(ns / step, 0.0, 0.0))

    def insert():
        chance = random.Random(1)
        while not stopped.is_set():
            late = [chance.randrange(step * count // 3, step * count * 2 // 3) for _ in range(200)]
            owner.set_transforms([placed(ns) for ns in late], "late")

    times = np.linspace(step, step * count, 20000).astype(np.int64)
    with pair(Duration(seconds=10**6)) as (owner, reader):
        owner.set_transforms([placed(step * (i + 1)) for i in range(count)], "first")
        thread = threading.Thread(target=insert)
        thread.start()
        try:
            for _ in range(30):
                for buffer in (reader, pickle.loads(pickle.dumps(reader))):
                    places, _ = buffer.lookup_transforms("map", "f", times)
                    assert np.abs(places[:, 0] - times / step).max() < 1e-6
        finally:
            stopped.set()
            thread.join()


def test_threads_read_while_the_owner_writes_and_others_join_and_leave():
    failed = []

    def read(seed):
        chance = random.Random(seed)
        try:
            found = 0
            for _ in range(20):
                buffer = Buffer(Duration(seconds=0.5), attach=owner.name)
                for _ in range(100):
                    found += is_sound(buffer, 1000 * S, [chance.randrange(S // 3) for _ in range(5)])
                if chance.random() < 0.5:
                    buffer._leave()
                    buffer._self_check()
                    found += is_sound(buffer, 1000 * S)
            assert found
        except BaseException as error:
            failed.append(error)
            raise

    with Owner() as owner:
        owner.tell("run", 0, 20)
        threads = [threading.Thread(target=read, args=(seed,)) for seed in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert failed == []


def test_leaving_while_the_owner_makes_new_names_loses_no_history():
    frames = [f"f{i}" for i in range(200)]
    stopped = threading.Event()

    def insert():
        k = 0
        while not stopped.is_set():
            k += 1
            for frame in frames[::7]:
                owner.set_transform(transform(f"new{k}", frame, ns=S + k), f"authority{k}")

    with pair(Duration(seconds=10)) as (owner, _):
        for ns in range(100):
            owner.set_transforms([transform("map", frame, ns=S // 2 + ns) for frame in frames], "first")
        thread = threading.Thread(target=insert)
        thread.start()
        try:
            for _ in range(30):
                reader = Buffer(attach=owner._sharing.name)
                reader._leave()
                reader._self_check()
                lost = [f for f in frames if not reader.can_transform_core("map", f, S // 2 + 50)[0]]
                assert not lost
        finally:
            stopped.set()
            thread.join()


def test_waiters_are_told_of_what_leaving_itself_has_brought():
    class Leaves(Buffer):
        armed = False

        def _follow(self, seconds, later):
            happened = super()._follow(seconds, later)
            if self.armed:
                # As another thread may do at this moment.
                owner.set_transform(transform("map", "late", ns=S), "owner")
                self._leave()
            return happened

    with pair() as (owner, _):
        reader = Leaves(attach=owner._sharing.name)
        waiting = reader.wait_for_transform_async("map", "late", at_ns(S))
        reader.armed = True
        reader._interrupt_following()
        assert until(waiting.done)
        assert not reader._is_attached


def test_what_changes_a_buffer_makes_it_leave_with_what_it_held():
    def inserts(buffer):
        buffer.set_transform(links(2 * S, 0)[0], "me")

    def starts_over(buffer):
        Buffer.__init__(buffer)

    for change, keeps in ((inserts, True), (Buffer.clear, False), (starts_over, False)):
        with pair() as (owner, reader):
            owner.set_transforms(links(1 * S, 0), "owner")
            owner.set_transform_static(transform("f0", "camera"), "owner")
            assert reader._is_attached
            change(reader)
            assert not reader._is_attached
            reader._self_check()
            assert reader.can_transform_core("map", "f4", 1 * S)[0] == keeps
            assert reader.can_transform_core("f0", "camera", 0)[0] == (change is not starts_over)
            owner.set_transforms(links(3 * S, 0), "owner")
            assert not reader.can_transform_core("map", "f4", 3 * S)[0]
            assert owner.can_transform_core("map", "f4", 3 * S)[0]


def test_an_owner_that_starts_over_takes_its_readers_along():
    with pair() as (owner, reader):
        owner.set_transforms(links(1 * S, 0), "owner")
        got = []
        wait = reader._wait("a", "b", 0, notify=got.append)
        assert reader.can_transform_core("map", "f4", 0)[0]
        tf2_py.BufferCore.__init__(owner, Duration(seconds=3))
        assert reader._getFrameStrings() == []
        assert reader.cache_time_ns == 3 * S
        owner.set_transform(transform("b", "f4", 1.0), "new")
        owner.set_transform(transform("a", "b", 1.0), "new")
        assert reader.can_transform_core("a", "f4", 0)[0]
        assert reader.all_frames_as_yaml() == owner.all_frames_as_yaml()
        reader._follow(0.0, [])
        assert got or wait.answer is not None


def test_a_buffer_that_was_filled_before_it_is_shared():
    owner = Buffer()
    owner.set_transforms(links(1 * S, 0), "owner")
    before = everything(owner, ["map", "f4"], [S])
    sharer = Sharer(owner, new_name())
    reader = Buffer(attach=sharer.name)
    assert everything(owner, ["map", "f4"], [S]) == everything(reader, ["map", "f4"], [S])
    assert bits(reader.lookup_transform_core("map", "f4", 0)) == outcome(
        owner.lookup_transform_core, "map", "f4", 0
    )
    assert before["yaml"] == reader.all_frames_as_yaml()
    owner._self_check()
    sharer.close()


def test_a_shared_buffer_ends_with_its_owner():
    owner = Buffer(share=new_name())
    name, path = owner._sharing.name, owner._sharing.path
    owner.set_transforms(links(1 * S, 0), "owner")
    reader = Buffer(attach=name)
    assert path.exists()
    del owner
    gc.collect()
    assert not path.exists()
    # What it held stays until somebody looks whether it lives.
    assert reader.can_transform_core("map", "f4", 0)[0]
    with pytest.raises(SharedBufferError, match="no process"):
        Buffer(attach=name)
    reader._leave()
    assert reader.can_transform_core("map", "f4", 0)[0]


def test_names_are_refused_before_anything_is_made():
    for wrong in ("", "/etc/passwd", "a/b", "a b", "é", ".", "x" * 101):
        for keyword in ("share", "attach"):
            with pytest.raises(ValueError, match="name of a shared buffer"):
                Buffer(**{keyword: wrong})
    with pytest.raises(TypeError, match="must be a str"):
        Buffer(share=3)
    with pytest.raises(ValueError, match="either"):
        Buffer(share="a", attach="b")


def test_auto_is_the_name_of_the_domain(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "77")
    owner = Buffer(share="auto")
    assert owner._sharing.name == "domain-77"
    assert Buffer(attach="auto")._is_attached
    owner._sharing.close()


def test_attaching_twice_says_whose_fault_it_is():
    with pair() as (owner, reader):
        refusal = f"cannot attach to .*{owner._sharing.name}': the buffer has shared memory already"
        with pytest.raises(SharedBufferError, match=refusal):
            reader.__init__(attach=owner._sharing.name)


# What another process has written over, as segment.pxd lays it out.
RINGS_SIXTEENTH = 3
ROWS_AT, ROW_BYTES, IS_PARENT = 131072, 64, 61


class SpoiledRing:
    """The samples of the only frame of an owner, in the file that its readers map."""

    def __init__(self, owner, stamps):
        self._path = segment_path(owner._sharing.name)
        with open(self._path, "rb") as file:
            start = os.fstat(file.fileno()).st_size // 16 * RINGS_SIXTEENTH
            memory = os.pread(file.fileno(), 1 << 16, start)
        at = memory.index(struct.pack(f"<{len(stamps)}q", *stamps))
        self._stamps = start + at
        # Behind the stamps, 64 bytes each; x is the stamp.
        self._samples = start + memory.index(struct.pack("<3d", float(stamps[0]), 0.0, 0.0), at)

    def _write(self, where, data):
        with open(self._path, "r+b") as file:
            os.pwrite(file.fileno(), data, where)

    def put_stamp(self, index, stamp):
        self._write(self._stamps + 8 * index, struct.pack("<q", stamp))

    def put_number(self, index, number, value):
        self._write(self._samples + 64 * index + 8 * number, struct.pack("<d", value))

    def put_is_parent(self, frame, value):
        self._write(ROWS_AT + ROW_BYTES * frame + IS_PARENT, bytes([value]))

    def put_parent(self, index, parent):
        self._write(self._samples + 64 * index + 56, struct.pack("<I", parent))


@pytest.fixture
def spoiled():
    """A reader of a history with 80 samples, the last one as late as can be, and the ring to be spoiled."""
    with pair(Duration(nanoseconds=2**62)) as (owner, reader):
        stamps = [*range(1000, 80_000, 1000), 2**31 * S - 1]
        for ns in stamps:
            owner.set_transform(transform("map", "f", ns=ns, xyz=(ns, 0, 0)), "x")
        assert reader.can_transform_core("map", "f", at_ns(1500))[0]
        yield reader, SpoiledRing(owner, stamps), stamps


def assert_holds(reader, stamps, places):
    reader._leave()
    reader._self_check()
    state = reader.__getstate__()
    assert state["stamps"].tolist() == stamps
    assert state["transforms"][:, 0].tolist() == places
    assert state["ever_looped"] is False


def test_a_reader_that_leaves_keeps_the_sound_samples_of_a_spoiled_history(spoiled):
    reader, ring, stamps = spoiled
    ring.put_stamp(3, -1)
    ring.put_stamp(5, 2**31 * S)
    ring.put_stamp(9, 500)
    ring.put_parent(11, 0)
    ring.put_parent(13, 1)  # itself
    ring.put_parent(15, 3)  # there are two frames
    for number in range(7):
        ring.put_number(20 + 2 * number, number, np.nan)
    ring.put_number(40, 6, -1.0)
    ring.put_is_parent(2, 0)
    lost = {3, 5, 9, 11, 13, 15, *range(20, 34, 2), 40}
    sound = [stamp for i, stamp in enumerate(stamps) if i not in lost]
    assert_holds(reader, sound, [float(stamp) for stamp in sound])


def test_a_reader_that_leaves_keeps_64_samples_of_one_stamp_of_a_spoiled_history(spoiled):
    reader, ring, stamps = spoiled
    for index in range(2, 70):
        ring.put_stamp(index, 3000)
    kept = [*range(66), *range(70, 80)]
    assert_holds(reader, [3000 if 2 <= i < 66 else stamps[i] for i in kept], [float(stamps[i]) for i in kept])
