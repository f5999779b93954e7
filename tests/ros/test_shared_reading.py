"""A buffer that is attached answers as the shared one does, after every step, whoever else changes it."""

import copy
import gc
import pickle
import random
import re
import threading

import pytest
from hypothesis import given
from making_objects import S, at_ns, transform
from pickles_and_copies import check_copy, everything
from random_inserts import apply, steps
from rclpy.duration import Duration
from repetitions import seeds
from ros_domains import claim_domain
from shared_buffers import LINKS, is_sound, links, new_name, pair, small_ring
from waiting import errors_so_far, until

from tf2_ros import Buffer, SharedBufferError

pytestmark = [pytest.mark.ours, pytest.mark.usefixtures("no_refusals_logged")]


def held(buffer):
    """All that it holds and counts, but for the waiters, which are its own."""
    found = everything(buffer)
    found["statistics"].pop("waiters")
    return found


@given(steps, steps)
def test_after_every_step_it_holds_what_the_owner_does(before, after):
    # The first steps are taken before anybody is attached. A cache time that drops nothing: who attaches
    # late is informed of what was received within it.
    owner = Buffer(Duration(seconds=10), share=new_name())
    try:
        apply(owner, before)
        reader = Buffer(attach=owner._tf2_sharing.name)
        assert reader.cache_time_ns == 10 * S
        for step in after:
            apply(owner, [step])
            assert held(reader) == held(owner)
            reader._self_check()
        late = Buffer(attach=owner._tf2_sharing.name)
        expected = held(owner)
        for buffer in (reader, late):
            assert held(buffer) == expected
        for copied in (pickle.loads(pickle.dumps(reader)), copy.copy(reader)):
            check_copy(copied, reader)
            buffer._self_check()
    finally:
        owner._tf2_sharing.close()


LOOKUPS = [(target, source, ns) for target in "abc" for source in "abcd" for ns in (0, 2, 5, 11)]


@pytest.mark.parametrize("seed", seeds(4, 20))
def test_a_waiter_is_told_of_every_change_that_helps_it(seed):
    # The invariant: what is pending would fail now.
    chance = random.Random(seed)
    answered = 0
    with pair(Duration(nanoseconds=10)) as (owner, reader):
        waiting = []

        def stuck():
            """Those that wait although there is an answer, and nobody is about to tell them."""
            return [
                (target, source, ns)
                for (target, source, ns), got, wait in waiting
                if not got and wait.take() is None and reader.can_transform_core(target, source, at_ns(ns))[0]
            ]

        for step in range(300):
            lookup = chance.choice(LOOKUPS)
            got = []
            wait = reader._wait(*lookup[:2], at_ns(lookup[2]), notify=got.append)
            if wait.take() is None:
                waiting.append((lookup, got, wait))
            what = chance.random()
            if what < 0.02:
                owner.clear()
            elif what < 0.025:
                reader.clear()  # it has a tree of its own
            else:
                names = chance.sample("abcd", 2)
                insert = owner.set_transform_static if what < 0.1 else owner.set_transform
                insert(transform(*names, ns=chance.randrange(step // 20, step // 20 + 12)), "random")
            if chance.random() < 0.1:
                until(lambda: not stuck())
                left = [one for one in waiting if not one[1] and one[2].take() is None]
                answered += len(waiting) - len(left)
                waiting = left
        reader._self_check()
    assert answered > 10


def test_a_reader_inserts_and_clears_for_itself_and_stays_attached():
    with pair() as (owner, reader):
        owner.set_transforms(links(1 * S, 0), "owner")
        owner.set_transform_static(transform("f0", "camera"), "owner")
        reader.set_transform(transform("f4", "own", ns=1 * S), "me")
        assert reader.can_transform_core("map", "own", 1 * S)[0]
        assert "own" not in owner
        reader.clear()
        assert not reader.can_transform_core("map", "f4", 1 * S)[0]
        assert reader.can_transform_core("f0", "camera", 0)[0]
        assert owner.can_transform_core("map", "f4", 1 * S)[0]
        owner.set_transforms(links(2 * S, 0), "owner")
        assert reader.can_transform_core("map", "f4", 2 * S)[0]
        assert reader._tf2_attachment.is_attached
        reader._self_check()


def test_a_callback_that_takes_long_delays_nothing_of_other_buffers():
    with pair() as (owner, reader), pair() as (other_owner, other):
        begun, release = threading.Event(), threading.Event()
        callbacks = []

        def wait(_):
            callbacks.append(threading.current_thread().name)
            begun.set()
            release.wait()

        slow = reader.wait_for_transform_async("map", "f0", at_ns(1 * S))
        slow.add_done_callback(wait)
        owner.set_transforms(links(1 * S, 0), "owner")
        until(begun.is_set)
        try:
            waiting = other.wait_for_transform_async("map", "f0", at_ns(1 * S))
            other_owner.set_transforms(links(1 * S, 0), "owner")
            until(waiting.done)
        finally:
            release.set()
        assert callbacks == ["tf2_ros callbacks"]


def wrap(owner, *readers):
    """Fill the smallest ring more than once, so that static transforms are written again."""
    for count in range(5000):
        owner.set_transforms(links((1000 + count) * S // 1000, S), "owner")
        if count % 100 == 0:
            assert all(reader.can_transform_core("map", "f4", 0)[0] for reader in readers)
    return 5000 * LINKS


def test_static_transforms_that_are_written_again_are_new_only_to_late_readers():
    with small_ring(), pair() as (owner, reader):
        for number in range(100):
            owner.set_transform_static(transform("map", f"static{number}", xyz=(number, 0.0, 0.0)), "owner")
        count = wrap(owner, reader)
        late = Buffer(attach=owner._tf2_sharing.name)
        for buffer in (reader, late):
            for number in range(100):
                found = buffer.lookup_transform_core("map", f"static{number}", 0)
                assert found.transform.translation.x == number
        assert reader.statistics()["taken"] == count + 100
        assert late.statistics()["taken"] < count
        # Nor do they replace what a reader has set.
        for buffer in (reader, late):
            buffer.set_transform_static(transform("map", "static1", xyz=(9.0, 0.0, 0.0)), "reader")
        wrap(owner, reader, late)
        for buffer in (reader, late):
            assert buffer.lookup_transform_core("map", "static1", 0).transform.translation.x == 9.0


def test_a_reader_that_sleeps_while_the_ring_wraps_begins_at_the_oldest_message():
    with small_ring(), pair(Duration(seconds=0.5)) as (owner, reader):
        assert not is_sound(reader, S)
        inserted = wrap(owner)
        assert is_sound(reader, S, range(0, S // 10, S // 100))
        assert reader.statistics()["malformed_messages"] == 0
        reader._self_check()
        assert reader.statistics()["taken"] < inserted


class TestAReaderThatIsOverrun:
    """It had not read what the owner had no room for any more, and logs that, with the way out."""

    def test_it_counts_that_and_one_warning_says_so(self, capfd):
        with small_ring(), pair() as (owner, reader):
            attachment = reader._tf2_attachment
            assert not is_sound(reader, S)
            wrap(owner)
            assert attachment.overruns()[0] == 0  # nobody has looked
            assert is_sound(reader, S)
            count, room_s = attachment.overruns()
            assert count == 1
            assert 0.0 < room_s < 10.0
            assert attachment.describe().endswith(", messages lost 1 time")
            warning = (
                f"Lost messages of the shared buffer {attachment.name!r} 1 time: newer messages displaced "
                f"them before this process read them. The shared buffer has room for {room_s:.1f} s, but "
                f"this buffer keeps 10 s. Make a lookup at least every {room_s:.1f} s, or give process "
                f"{attachment.owner} a larger /dev/shm, up to 1 GiB\n"
            )
            until(lambda: warning in errors_so_far())

    def test_the_next_warning_comes_later_and_counts_from_the_last_one(self, capfd, monkeypatch):
        with small_ring(), pair() as (owner, reader):
            attachment = reader._tf2_attachment
            for _ in range(3):
                wrap(owner)
                assert is_sound(reader, S)
                until(lambda: "1 time: newer messages" in errors_so_far())
            attachment._tf2_check()
            assert "2 times" not in errors_so_far()
            monkeypatch.setattr("tf2_ros._shared.attachment.LOSS_WARNING_S", 0)
            until(lambda: "2 times: newer messages" in errors_so_far())

    def test_one_that_reads_in_time_loses_nothing(self):
        with small_ring(), pair() as (owner, reader):
            wrap(owner, reader)
            assert reader._tf2_attachment.overruns()[0] == 0

    def test_what_is_older_than_the_cache_time_of_the_owner_is_not_lost(self):
        with small_ring(), pair(Duration(nanoseconds=10)) as (owner, reader):
            inserted = wrap(owner)
            assert reader.can_transform_core("map", "f4", 0)[0]
            assert reader.statistics()["taken"] < inserted
            assert reader._tf2_attachment.overruns()[0] == 0

    def test_what_the_reader_itself_would_not_keep_is_not_lost(self):
        with small_ring(), pair() as (owner, reader):
            brief = Buffer(Duration(nanoseconds=10), attach=owner._tf2_sharing.name)
            wrap(owner)
            for buffer in (reader, brief):
                assert buffer.can_transform_core("map", "f4", 0)[0]
            assert reader._tf2_attachment.overruns()[0] == 1
            assert brief._tf2_attachment.overruns()[0] == 0

    def test_static_transforms_are_not_lost(self):
        with small_ring(), pair() as (owner, reader):
            for number in range(10_000):
                mount = transform("map", f"static{number % 10}", xyz=(number, 0.0, 0.0))
                owner.set_transform_static(mount, "owner")
            for number in range(10):
                found = reader.lookup_transform_core("map", f"static{number}", 0)
                assert found.transform.translation.x == 9990 + number
            assert reader.statistics()["taken"] < 10_000
            assert reader._tf2_attachment.overruns()[0] == 0


class TestAnOwnerWithoutRoom:
    """It logs what those lack who attach to it."""

    def test_a_ring_that_is_too_small_for_the_cache_time_is_one_warning(self, capfd):
        with small_ring(), pair() as (owner, _):
            sharing = owner._tf2_sharing
            for _ in range(2):
                wrap(owner)
                sharing._tf2_check()
            lines = [line for line in errors_so_far().splitlines() if "has room for" in line]
            assert len(lines) == 1
            assert re.search(
                rf"The shared buffer '{sharing.name}' has room for the last [0-9.]+ s of messages, but its "
                r"cache time is 10 s\.",
                lines[0],
            )

    def test_messages_older_than_the_cache_time_need_no_room(self, capfd):
        with small_ring(), pair(Duration(nanoseconds=10)) as (owner, _):
            wrap(owner)
            owner._tf2_sharing._tf2_check()
            assert "has room for" not in errors_so_far()

    def test_names_that_fit_no_record_are_counted_and_the_others_shared(self, capfd):
        with pair() as (owner, reader):
            long = [transform("map", letter * 200_000, ns=S) for letter in "ab"]
            owner.set_transforms([*long, transform("map", "camera", ns=S)], "owner")
            owner._tf2_sharing._tf2_check()
            assert reader.can_transform_core("map", "camera", 0)[0]
            assert (
                f"The shared buffer '{owner._tf2_sharing.name}' lacks 2 transforms: frame names that are "
                "longer than 100 kB are not shared"
            ) in errors_so_far()


def test_a_message_larger_than_a_record_may_be_is_shared_in_parts():
    with pair() as (owner, reader):
        assert owner.set_transforms([transform("map", f"f{i}", ns=S) for i in range(20000)], "me") == 20000
        assert reader.can_transform_core("map", "f19999", 0)[0]
        assert len(reader._getFrameStrings()) == 20001


def test_a_shared_buffer_ends_with_its_owner():
    owner = Buffer(share=new_name())
    name, path = owner._tf2_sharing.name, owner._tf2_sharing.path
    owner.set_transforms(links(1 * S, 0), "owner")
    reader = Buffer(attach=name)
    assert path.exists()
    del owner
    # The thread that reports may be looking at it just now.
    until(lambda: gc.collect() >= 0 and not path.exists())
    # What it shared is read even now.
    assert reader.can_transform_core("map", "f4", 0)[0]
    with pytest.raises(SharedBufferError, match="no process"):
        Buffer(attach=name)
    until(lambda: not reader._tf2_attachment.is_attached)
    assert reader.can_transform_core("map", "f4", 0)[0]


def test_names_are_refused_before_anything_is_made():
    for wrong in ("", "/etc/passwd", "a/b", "a b", "é", ".", "x" * 101):
        for keyword in ("share", "attach"):
            with pytest.raises(ValueError, match="name of a shared buffer"):
                Buffer(**{keyword: wrong})
    with pytest.raises(TypeError, match="expected a str"):
        Buffer(share=3)
    with pytest.raises(ValueError, match="mutually exclusive"):
        Buffer(share="a", attach="b")


def test_auto_is_the_name_of_the_domain(monkeypatch):
    domain = claim_domain()  # of this test run alone, and no tf2_shared_buffer's
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    owner = Buffer(share="auto")
    assert owner._tf2_sharing.name == f"domain-{domain}"
    assert Buffer(attach="auto")._tf2_attachment.is_attached
    owner._tf2_sharing.close()
