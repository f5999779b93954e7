"""Owners that die, stop or fork at any moment, and files that are not what they should be: readers go on."""

import fcntl
import gc
import os
import random
import signal
import struct
import sys
import threading
import time
from contextlib import suppress
from functools import partial

import pytest
from interposed_libraries import output_with_library
from making_objects import S, at_ns, transform
from processes import run
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from rclpy.time import Time
from repetitions import seeds, times
from shared_buffers import Intruder, Owner, is_sound, links, new_name, pair, ring_threads, small_ring
from spinning_nodes import at_once, repeated
from waiting import PROMPT_S, until

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, SharedBufferError
from tf2_ros._receive.inbox import INBOXES
from tf2_ros._shared.shared_names import segment_path

pytestmark = pytest.mark.ours

FIRST_NS = 1000 * S
LATER = at_ns(10**6 * S)  # what an owner never inserts
KILLS = times(5, 12)
RING_AT = 1 << 16  # as in ring.pyx


def insert_later(buffer):
    for link in links(LATER.nanoseconds, FIRST_NS):
        buffer.set_transform(link, "test")


@pytest.mark.repeated
@pytest.mark.parametrize("seed", seeds(2, 4))
def test_readers_outlive_owners_that_are_killed_at_any_moment(seed):
    chance = random.Random(seed)
    held = 0
    with Owner(name="children") as mother:
        for _ in range(KILLS):
            name = new_name()
            mother.tell(name)
            reader = Buffer(Duration(seconds=0.5), attach=name)
            waiting = reader.wait_for_transform_async("map", "f4", LATER)
            with repeated(*[partial(_look_up, reader)] * 2):
                threading.Event().wait(chance.random() * 0.02)
                print("kill", file=mother.process.stdin, flush=True)
                until(lambda: not reader._tf2_attachment.is_attached)  # noqa: B023
            reader._self_check()
            held += is_sound(reader, FIRST_NS, range(0, S // 3, S // 50))
            assert not waiting.done()
            insert_later(reader)
            assert until(waiting.done)
            segment_path(name).unlink(missing_ok=True)
    assert held == KILLS


def _look_up(reader):
    is_sound(reader, FIRST_NS, (0, S // 10, S // 5))
    reader.all_frames_as_yaml()


def test_a_reader_of_an_owner_that_is_stopped_neither_hangs_nor_breaks():
    # At any moment: some of these are in the middle of a message.
    chance = random.Random(6)
    with Owner() as owner:
        owner.tell("run", 60)
        for _ in range(40):
            reader = Buffer(Duration(seconds=0.5), attach=owner.name)
            waiting = reader.wait_for_transform_async("map", "f4", LATER)
            threading.Event().wait(chance.random() * 0.01)
            os.kill(owner.process.pid, signal.SIGSTOP)
            try:
                begun = time.monotonic()
                for _ in range(20):
                    is_sound(reader, FIRST_NS, (0, S // 10))
                assert time.monotonic() - begun < PROMPT_S
                reader._self_check()
                assert reader.statistics()["malformed_messages"] == 0
                # It may go on.
                reader._tf2_attachment._tf2_check()
                assert reader._tf2_attachment.is_attached
                insert_later(reader)
                assert until(waiting.done)
            finally:
                os.kill(owner.process.pid, signal.SIGCONT)
            reader._tf2_attachment.close()


def test_a_child_that_outlives_an_owner_does_not_keep_the_name():
    with Owner() as owner:
        owner.tell("fork")
        reader = Buffer(attach=owner.name)
        owner.process.kill()
        until(lambda: not reader._tf2_attachment.is_attached)
        Buffer(share=owner.name)._tf2_sharing.close()


def test_a_second_owner_is_refused_with_the_first_ones_process():
    with Owner() as owner:
        with pytest.raises(SharedBufferError, match=f"owned by process {owner.process.pid}$"):
            Buffer(share=owner.name)
        owner.process.kill()
        owner.process.wait()
        with pytest.raises(SharedBufferError, match="no process"):
            Buffer(attach=owner.name)
        mine = Buffer(share=owner.name)
        with pytest.raises(SharedBufferError, match=f"owned by process {os.getpid()}$"):
            Buffer(share=owner.name)
        assert Buffer(attach=owner.name)._tf2_attachment.is_attached
        mine._tf2_sharing.close()


@pytest.mark.parametrize("keyword", ["share", "attach"])
def test_threads_of_one_process_do_not_take_a_file_from_each_other(keyword):
    for _ in range(60):
        name = new_name()
        made = []

        def make(*keywords, name=name, made=made):
            for keyword in keywords:
                with suppress(SharedBufferError):
                    made.append(Buffer(**{keyword: name}))

        at_once(partial(make, "share"), partial(make, *[keyword] * (1 if keyword == "share" else 10)))
        (owner,) = [buffer._tf2_sharing for buffer in made if buffer._tf2_sharing is not None]
        assert owner.path.exists()
        owner.close()


def test_an_attachment_that_is_closed_stays_closed_whoever_checks_it_meanwhile():
    with pair() as (owner, _):
        for _ in range(100):
            reader = Buffer(attach=owner._tf2_sharing.name)
            attachment = reader._tf2_attachment
            at_once(attachment.close, *[attachment._tf2_check] * 3)
            attachment._tf2_check()
            assert reader._tf2_attachment is None and not attachment.is_attached


def test_an_owner_that_ends_while_the_next_one_starts_is_followed_by_one_thread():
    until(lambda: gc.collect() >= 0 and ring_threads() == 0)  # those of earlier tests
    for _ in range(50):
        name = new_name()
        first = Buffer(share=name)
        reader = Buffer(attach=name)

        def start_next(name=name, first=first):
            first._tf2_sharing.close()
            return Buffer(share=name)

        def check(reader=reader):
            reader._tf2_attachment._tf2_check()

        second, *_ = at_once(start_next, check, check, check)
        check()
        second.set_transforms(links(1 * S, 0), "owner")
        assert reader.can_transform_core("map", "f4", 1 * S)[0]
        until(lambda: ring_threads() == 1)
        reader._tf2_attachment.close()
        second._tf2_sharing.close()


REFUSED = {
    "cannot .*: .*symbolic links": lambda path: path.symlink_to("/dev/null"),
    "cannot .*: .*directory": lambda path: path.mkdir(),
    "it belongs to another user: '/dev/shm/": lambda path: (path.touch(0o600), os.chown(path, 65534, 65534)),
    "it is not a regular file: '/dev/shm/": lambda path: os.mkfifo(path, 0o600),
    "other users may write to it; its mode is 0620: ": lambda path: (path.touch(), path.chmod(0o620)),
    "other users may write to it; its mode is 0602: ": lambda path: (path.touch(), path.chmod(0o602)),
}


@pytest.mark.parametrize("match", REFUSED)
def test_a_file_that_is_not_this_users_own_is_refused(match):
    if "user's" in match and os.geteuid() != 0:
        pytest.skip("it takes a superuser to be somebody else")
    name = new_name()
    path = segment_path(name)
    try:
        REFUSED[match](path)
        for keyword in ("share", "attach"):
            with pytest.raises(SharedBufferError, match=match):
                Buffer(**{keyword: name})
    finally:
        path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)


def test_a_process_that_locks_the_file_of_a_dead_owner_is_named_and_not_waited_for():
    with Owner() as owner, open(owner.path, "rb") as file:
        owner.process.kill()
        owner.process.wait()
        fcntl.flock(file, fcntl.LOCK_SH)
        match = f"it is locked by process {os.getpid()}: '{owner.path}'$"
        with pytest.raises(SharedBufferError, match=match):
            Buffer(share=owner.name)
        fcntl.flock(file, fcntl.LOCK_UN)
        Buffer(share=owner.name)._tf2_sharing.close()


def spoiled(path, where, data):
    with open(path, "r+b") as file:
        file.seek(where)
        file.write(data)


@pytest.mark.parametrize(
    ("where", "data", "match"),
    [
        (0, b"\1" * 8, "not a shared buffer"),
        (8, struct.pack("<I", 0), "another version"),
        (16, struct.pack("<Q", 9), "the size in its header"),
        (16, struct.pack("<Q", 2**63), "the size in its header"),
        (16, struct.pack("<Q", 2**39), "the size in its header"),
    ],
)
def test_a_file_of_another_kind_is_refused(where, data, match):
    with Owner() as owner:
        spoiled(owner.path, where, data)
        with pytest.raises(SharedBufferError, match=match):
            Buffer(attach=owner.name)


def test_a_truncated_file_breaks_nothing():
    for size in (4096, RING_AT, RING_AT + 4096):
        with Owner() as owner:
            owner.tell("insert", S, 0)
            reader = Buffer(attach=owner.name)
            waiting = reader.wait_for_transform_async("map", "f4", LATER)
            os.truncate(owner.path, size)
            assert owner.tell("insert", 2 * S, 0)[0] == "done"
            is_sound(reader, 0)
            reader._self_check()
            insert_later(reader)
            assert until(waiting.done)


def test_a_malformed_message_in_shared_memory_is_counted_and_the_rest_is_read():
    with Owner() as owner:
        for ns in range(S, 3 * S, S // 10):
            owner.tell("insert", ns, 0)
        with open(owner.path, "r+b", buffering=0) as file:
            memory = os.pread(file.fileno(), 1 << 16, RING_AT)
            at = memory.index(b"map\0", 2000)
            os.pwrite(file.fileno(), b"\xff", RING_AT + at)
        reader = Buffer(attach=owner.name)
        assert is_sound(reader, 0)
        until(lambda: reader.statistics()["malformed_messages"] == 1)
        reader._self_check()


# Positions of a ring; its records begin at multiples of 64.
FAR = 2**62
ODD = [0, 63, FAR - 64, FAR + 1, 2**63 - 64, 2**63, 2**64 - 2**17, 2**64 - 64, 2**64 - 1]


@pytest.mark.parametrize("oldest", ODD)
def test_positions_that_no_owner_writes_break_nothing(oldest):
    for newest in (*ODD, oldest):  # one reader meets them all
        with small_ring(), pair() as (owner, reader), Intruder(owner._tf2_sharing.path) as intruder:
            owner.set_transforms(links(1 * S, 0), "owner")
            assert is_sound(reader, 0)
            at, end, _ = intruder.head()
            # A valid record where the damaged head points, and a position from which on the sums wrap.
            if oldest % 64 == 0:
                intruder.copy(at, oldest)
            wrapping = 2**64 - 64
            for head in ((oldest, newest), (oldest, wrapping), (oldest, 10**6), (wrapping, newest, oldest)):
                intruder.set_head(*head)
                is_sound(reader, 0)
                with suppress(SharedBufferError):
                    is_sound(Buffer(attach=owner._tf2_sharing.name), 0)
            reader._self_check()
            until(lambda: reader.statistics()["malformed_messages"] > 0)
            intruder.set_head(at, end, 0)
            is_sound(reader, 0)  # it passes over what was overwritten
            owner.set_transforms(links(2 * S, 0), "owner")
            assert reader.can_transform_core("map", "f4", 2 * S)[0]


def random_record(chance, stamp_ns):
    """
    The content of a record, what to change in its head and where, and what it counts for.

    That is: accepted transforms, malformed messages, whether the reader goes on behind all records.
    """
    count = chance.randint(0, 3)
    message = TFMessage(transforms=[transform("map", f"f{i}", ns=stamp_ns) for i in range(count)])
    content = bytes(serialize_message(message))
    kind = chance.random()
    if kind < 0.6:
        return content, b"", 0, (count, 0, False)
    if kind < 0.7 and count:  # torn in the last transform
        return content[: -chance.randint(1, 50)], b"", 0, (0, 1, False)
    if kind < 0.8:  # of no encoding that there is
        return b"\xff" + chance.randbytes(chance.randint(0, 200)), b"", 0, (0, 1, False)
    # Another position, another kind, or sizes with which it reaches beyond the newest record.
    change, at = chance.choice(
        [
            (struct.pack("=Q", chance.getrandbits(64)), 0),
            (struct.pack("=I", chance.randint(4, 2**32 - 1)), 24),
            (struct.pack("=I", chance.randint(2**17, 2**32 - 1)), 32),
            (struct.pack("=I", chance.randint(2**17, 2**32 - 1)), 36),
        ]
    )
    return content, change, at, (0, 1, True)


@pytest.mark.parametrize("seed", seeds(1, 4))
def test_of_random_records_the_valid_ones_are_inserted_and_the_others_counted(seed):
    """Valid, torn and hostile ones; one with a wrong head hides those behind it that are there already."""
    chance, records, taken, malformed = random.Random(seed), 0, 0, 0
    with small_ring(), pair() as (owner, reader), Intruder(owner._tf2_sharing.path) as intruder:
        inbox = reader._tf2_attachment.inbox
        _, position, _ = intruder.head()
        while records < 25_000:
            is_hidden = False
            for _ in range(chance.randint(1, 20)):
                records += 1
                content, change, at, (more_taken, more_malformed, hides) = random_record(chance, records)
                start, position = position, intruder.write(position, 1, content)
                place = intruder.place(start) + at
                intruder.memory[place : place + len(change)] = change
                if not is_hidden:
                    taken, malformed, is_hidden = taken + more_taken, malformed + more_malformed, hides
            intruder.set_head(position - intruder.capacity // 4, position)
            inbox.catch_up()
            assert reader.statistics()["taken"] == taken
            INBOXES.report_next()
        until(lambda: reader.statistics()["malformed_messages"] == malformed)
        reader._self_check()


def test_a_reader_reads_each_byte_once(tmp_path):
    """The owner could change a byte between the check and the use."""
    assert output_with_library("spoiled_records", tmp_path) == "501 frames, 0 malformed messages\n"


def test_an_answer_is_delivered_although_malformed_messages_wait_to_be_reported():
    """A removal that ends a loop answers a future, while the thread that reports waits for the GIL."""
    junk, removal = 1, 3  # kinds of records
    with small_ring(), pair() as (owner, reader), Intruder(owner._tf2_sharing.path) as intruder:
        for parent, child in (("a", "z"), ("a", "b"), ("b", "a")):
            owner.set_transform(transform(parent, child, 1), "owner")
        assert "b" in reader
        future = reader.wait_for_transform_async("z", "b", Time())
        oldest, position, _ = intruder.head()
        ends = [position := intruder.write(position, junk, b"not a message") for _ in range(90)]
        ends = [*ends[29::30], intruder.write(position, removal, b"a")]
        interval = sys.getswitchinterval()
        sys.setswitchinterval(10)
        try:
            for end in ends:
                intruder.set_head(oldest, end)
                assert "z" in reader  # a read inserts what has arrived
        finally:
            sys.setswitchinterval(interval)
        until(future.done)
        assert future.result().header.frame_id == "z"
        assert reader.statistics()["malformed_messages"] == 90


@pytest.mark.skipif(os.geteuid() != 0, reason="it takes a superuser to mount a file system")
def test_memory_that_ends():
    # A small /dev/shm, in a mount namespace of its own.
    code = (
        "from making_objects import S, transform\n"
        "from waiting import until\n"
        "from tf2_ros import Buffer\n"
        "b = Buffer(share='small'); r = Buffer(attach='small')\n"
        "b.set_transforms([transform('map', f'f{i}', ns=S) for i in range(2000)], 'me')\n"
        "assert 'f1999' in r\n"
        "filling = open('/dev/shm/other', 'wb', buffering=0)\n"
        "try:\n"
        "    while True: filling.write(bytes(65536))\n"
        "except OSError: pass\n"
        "n = b.set_transforms([transform('map', f'g{i}', ns=S) for i in range(20000)], 'me')\n"
        "assert n == 20000 and 'g19999' in b\n"
        "until(lambda: not r._tf2_attachment.is_attached)\n"
        "for one in (b, r): one._self_check()\n"
        "print('f1999' in r, b._tf2_sharing.path.exists())"
    )
    command = 'mount -t tmpfs -o size=2m tmpfs /dev/shm || exit 77; exec "$@"'
    ended = run("unshare", "-m", "sh", "-c", command, "sh", sys.executable, "-c", code)
    if ended.returncode == 77 or "unshare" in ended.stderr:
        pytest.skip("no file system can be mounted here")
    assert ended.stdout == "True False\n", ended.stderr
    assert "The shared buffer 'small' has ended, because there was no memory for a message" in ended.stderr
