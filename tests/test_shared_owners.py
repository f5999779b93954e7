"""Owners that die, stop or fork at any moment, and files that are not what they should be: readers go on."""

import os
import random
import signal
import struct
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from forking import in_a_child
from making import S, at_ns, transform
from processes import DEADLINE_S, until
from rclpy.duration import Duration
from sharing import LINKS, PROGRAMS, Owner, is_sound, links, new_name, pair

from tf2_ros import Buffer, SharedBufferError
from tf2_ros._shared.names import segment_path
from tf2_ros._shared.owning import Owner as Sharer

pytestmark = pytest.mark.ours

FIRST_NS = 1000 * S
LATER = at_ns(10**6 * S)  # what an owner never inserts
KILLS = 200
FRAMES_AT, ROWS_AT, NAMES_SIXTEENTH, RINGS_SIXTEENTH = 72, 131072, 1, 3  # as in segment.pxd


def insert_later(buffer):
    for link in links(LATER.nanoseconds, FIRST_NS):
        buffer.set_transform(link, "test")


def test_readers_outlive_owners_that_are_killed_at_any_moment():
    # Several at a time, so that all of it happens under load.
    with ThreadPoolExecutor(4) as several:
        held = sum(several.map(_outlive, range(4)))
    assert held == KILLS // 4 * 4


def _outlive(seed):
    """Outlive a quarter of the owners; how many had left something."""
    chance = random.Random(seed)
    held = 0
    with Owner(name="children") as mother:
        for _ in range(KILLS // 4):
            name = new_name()
            mother.tell(name)
            reader = Buffer(Duration(seconds=0.5), attach=name)
            waiting = reader.wait_for_transform_async("map", "f4", LATER)
            stopped = threading.Event()
            threads = [threading.Thread(target=_look_up, args=(reader, stopped)) for _ in range(2)]
            for thread in threads:
                thread.start()
            stopped.wait(chance.random() * 0.02)
            print("kill", file=mother.process.stdin, flush=True)
            until(lambda: not reader._is_attached)  # noqa: B023
            stopped.set()
            for thread in threads:
                thread.join()
            reader._self_check()
            held += is_sound(reader, FIRST_NS, range(0, S // 3, S // 50))
            assert not waiting.done()
            insert_later(reader)
            assert until(waiting.done)
            segment_path(name).unlink(missing_ok=True)
    return held


def _look_up(reader, stopped):
    while not stopped.is_set():
        is_sound(reader, FIRST_NS, (0, S // 10, S // 5))
        reader.all_frames_as_yaml()


def test_a_reader_of_an_owner_that_is_stopped_neither_hangs_nor_breaks():
    chance = random.Random(6)
    with Owner() as owner:
        owner.tell("run", 0, 60)
        for _ in range(40):
            reader = Buffer(Duration(seconds=0.5), attach=owner.name)
            waiting = reader.wait_for_transform_async("map", "f4", LATER)
            threading.Event().wait(chance.random() * 0.01)
            os.kill(owner.process.pid, signal.SIGSTOP)
            try:
                begun = time.monotonic()
                for _ in range(20):
                    is_sound(reader, FIRST_NS, (0, S // 10))
                assert time.monotonic() - begun < 5.0
                reader._self_check()
                if not reader._is_attached:
                    assert "stopped in the middle" in reader._why_left
                    insert_later(reader)
                    assert until(waiting.done)
            finally:
                os.kill(owner.process.pid, signal.SIGCONT)
            reader._sharing.stop()


def test_a_reader_that_is_killed_or_stopped_holds_up_nobody():
    code = (
        "import sys; from tf2_ros import Buffer; b = Buffer(attach=sys.argv[1]); print('up', flush=True)\n"
        "f = b.wait_for_transform_async('map', 'nowhere', 0)\n"
        "while True: b.can_transform_core('map', 'f4', 0)"
    )
    with Owner() as owner:
        owner.tell("run", 0, 60)
        reader = Buffer(attach=owner.name)
        for end in (signal.SIGKILL, signal.SIGSTOP) * 3:
            other = subprocess.Popen(
                [sys.executable, "-c", code, owner.name], stdout=subprocess.PIPE, text=True
            )
            try:
                assert other.stdout.readline() == "up\n"
                other.send_signal(end)
                before = reader.statistics()["taken"]
                until(lambda: reader.statistics()["taken"] > before + 100)  # noqa: B023
            finally:
                other.kill()
                other.communicate()


def test_a_forked_child_of_the_owner_reads_what_its_parent_inserts():
    with pair() as (owner, reader):
        owner.set_transforms(links(1 * S, 0), "parent")
        inserted = os.pipe()

        def child():
            os.close(inserted[1])
            assert owner._is_attached
            assert owner.can_transform_core("map", "f4", 1 * S)[0]
            waiting = owner.wait_for_transform_async("map", "f4", at_ns(2 * S))
            assert until(waiting.done)
            assert os.read(inserted[0], 1) == b"x"
            assert owner.can_transform_core("map", "f4", 2 * S)[0]
            assert reader.can_transform_core("map", "f4", 2 * S)[0]
            # What changes it makes it leave; the parent's stays as it is.
            owner.set_transform(transform("f4", "own", ns=2 * S), "child")
            assert not owner._is_attached
            assert owner.can_transform_core("map", "own", 2 * S)[0]
            owner._self_check()

        thread = threading.Timer(
            0.2, lambda: (owner.set_transforms(links(2 * S, 0), "parent"), os.write(inserted[1], b"x"))
        )
        thread.start()
        assert in_a_child(child) == 0
        thread.join()
        os.close(inserted[0])
        os.close(inserted[1])
        assert owner._sharing.path.exists()
        assert not owner.can_transform_core("map", "own", 2 * S)[0]
        owner.set_transforms(links(3 * S, 0), "parent")
        assert reader.can_transform_core("map", "f4", 3 * S)[0]
        owner._self_check()
        with pytest.raises(SharedBufferError):
            Buffer(share=owner._sharing.name)


def test_a_forked_child_of_a_reader_is_a_reader():
    with Owner() as owner:
        owner.tell("insert", S, 0)
        reader = Buffer(attach=owner.name)

        def child():
            assert reader.can_transform_core("map", "f4", 1 * S)[0]
            owner.tell("insert", 2 * S, 0)
            assert reader.can_transform_core("map", "f4", 2 * S)[0]
            waiting = reader.wait_for_transform_async("map", "f4", at_ns(3 * S))
            owner.tell("insert", 3 * S, 0)
            assert until(waiting.done)

        assert in_a_child(child) == 0
        assert reader.can_transform_core("map", "f4", 3 * S)[0]


@pytest.mark.parametrize("which", ["owner", "reader"])
def test_a_wait_that_a_child_inherited_is_answered_when_the_child_inserts(which):
    """By what the owner had inserted since the fork: the child has no thread that follows it."""
    with pair() as pair_of_buffers:
        owner, reader = pair_of_buffers
        owner.set_transforms(links(1 * S, 0), "parent")
        buffer = owner if which == "owner" else reader
        waiting = buffer.wait_for_transform_async("map", "f4", at_ns(2 * S))
        begun, inserted = os.pipe(), os.pipe()

        def child():
            os.write(begun[1], b"x")
            assert os.read(inserted[0], 1) == b"x"
            assert buffer._is_attached and not waiting.done()
            buffer.set_transform(transform("other", "tree", ns=1 * S), "child")
            assert waiting.done()
            assert waiting.result().header.stamp.sec == 2
            buffer._self_check()

        def insert():
            os.read(begun[0], 1)
            owner.set_transforms(links(2 * S, 0), "parent")
            os.write(inserted[1], b"x")

        thread = threading.Thread(target=insert)
        thread.start()
        assert in_a_child(child) == 0
        thread.join()
        for end in (*begun, *inserted):
            os.close(end)


def test_a_second_owner_is_refused_with_the_first_ones_process():
    with Owner() as owner:
        with pytest.raises(SharedBufferError, match=f"owned by process {owner.process.pid}$"):
            Buffer(share=owner.name)
        owner.process.kill()
        owner.process.wait()
        # What a dead one left is taken over.
        assert owner.path.exists()
        mine = Buffer(share=owner.name)
        with pytest.raises(SharedBufferError, match=f"owned by process {os.getpid()}$"):
            Buffer(share=owner.name)
        assert Buffer(attach=owner.name)._is_attached
        mine._sharing.close()


def test_what_a_dead_owner_left_is_removed_by_whoever_finds_it():
    with Owner() as owner:
        owner.process.kill()
        owner.process.wait()
        assert owner.path.exists()
        with pytest.raises(SharedBufferError, match="no process"):
            Buffer(attach=owner.name)
        assert not owner.path.exists()


def test_of_many_who_want_to_be_the_owner_one_is():
    name = new_name()
    code = (
        "import sys; from tf2_ros import Buffer, SharedBufferError\n"
        "input()\n"
        "try: b = Buffer(share=sys.argv[1])\n"
        "except SharedBufferError as error: print(error)\n"
        "else: print('owner'); sys.stdout.flush(); input()"
    )
    segment_path(name).write_bytes(b"left by somebody who died")
    segment_path(name).chmod(0o600)
    several = [
        subprocess.Popen(
            [sys.executable, "-c", code, name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(6)
    ]
    try:
        for one in several:
            one.stdin.write("go\n")
            one.stdin.flush()
        said = [one.stdout.readline() for one in several]
    finally:
        for one in several:
            one.communicate()
    assert said.count("owner\n") == 1
    assert all("owned by process" in line for line in said if line != "owner\n")
    assert not segment_path(name).exists()


@pytest.mark.parametrize("keyword", ["share", "attach"])
def test_threads_of_one_process_do_not_take_a_file_from_each_other(keyword):
    # A record lock does not exclude them, and is lost when any of them closes the file.
    for _ in range(150):
        name = new_name()
        made = []
        start = threading.Barrier(2)

        def make(keywords, name=name, made=made, start=start):
            start.wait()
            for keyword in keywords:
                with suppress(SharedBufferError):
                    made.append(Buffer(**{keyword: name}))

        others = [keyword] if keyword == "share" else [keyword] * 10
        threads = [threading.Thread(target=make, args=(keywords,)) for keywords in (["share"], others)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        owners = [buffer._sharing for buffer in made if isinstance(buffer._sharing, Sharer)]
        assert len(owners) == 1
        assert owners[0].path.exists()
        owners[0].close()


def spoiled(path, where, data):
    with open(path, "r+b") as file:
        file.seek(where)
        file.write(data)


@pytest.mark.parametrize(
    ("where", "data", "match"),
    [
        (0, b"\1" * 8, "no shared buffer"),
        (8, struct.pack("<I", 9), "another version"),
        (12, struct.pack("<I", 9), "another layout"),
        (24, struct.pack("<Q", 9), "truncated"),
    ],
)
def test_a_file_of_another_kind_is_refused(where, data, match):
    with Owner() as owner:
        spoiled(owner.path, where, data)
        with pytest.raises(SharedBufferError, match=match):
            Buffer(attach=owner.name)


def test_a_file_that_is_none_is_refused():
    name = new_name()
    path = segment_path(name)
    try:
        path.write_bytes(b"")
        path.chmod(0o644)
        with pytest.raises(SharedBufferError, match="other users"):
            Buffer(attach=name)
        with pytest.raises(SharedBufferError, match="other users"):
            Buffer(share=name)
        path.unlink()
        path.symlink_to("/dev/null")
        with pytest.raises(SharedBufferError):
            Buffer(attach=name)
        with pytest.raises(SharedBufferError):
            Buffer(share=name)
        path.unlink()
        path.mkdir()
        with pytest.raises(SharedBufferError):
            Buffer(share=name)
        path.rmdir()
    finally:
        path.unlink(missing_ok=True)


@pytest.mark.skipif(os.geteuid() != 0, reason="it takes a superuser to be somebody else")
def test_another_users_file_is_refused():
    name = new_name()
    path = segment_path(name)
    path.write_bytes(b"x" * 10000)
    path.chmod(0o600)
    os.chown(path, 65534, 65534)
    try:
        for keyword in ("share", "attach"):
            with pytest.raises(SharedBufferError, match="not this user's"):
                Buffer(**{keyword: name})
    finally:
        path.unlink()


def test_a_file_that_is_truncated_is_left():
    for size in (0, 4096, ROWS_AT, 2**20):
        with Owner() as owner:
            owner.tell("insert", S, 0)
            reader = Buffer(attach=owner.name)
            idle = Buffer(attach=owner.name)
            waiting = reader.wait_for_transform_async("map", "f4", LATER)
            os.truncate(owner.path, size)
            until(lambda: not reader._is_attached)  # noqa: B023
            reader._self_check()
            insert_later(reader)
            assert until(waiting.done)
            is_sound(idle, 0)
            idle._leave()
            idle._self_check()
            # The owner goes on for itself.
            assert owner.process.poll() is None
            print("insert", 2 * S, 0, file=owner.process.stdin, flush=True)
            assert owner.said()[0] == "done"


BUS_ERROR = """
import faulthandler, mmap, os, signal, sys
from tf2_ros import Buffer
first = Buffer(share=sys.argv[1] + "-1")
faulthandler.enable()
second = Buffer(share=sys.argv[1] + "-2")
if sys.argv[2] == "sent":
    os.kill(os.getpid(), signal.SIGBUS)
with open(sys.argv[3], "w+b") as file:
    file.truncate(8192)
    memory = mmap.mmap(file.fileno(), 8192)
    file.truncate(0)
    memory[5000]
"""


@pytest.mark.parametrize("how", ["sent", "happens"])
def test_a_bus_error_elsewhere_ends_the_process_once(how, tmp_path):
    # The handler of the second buffer and faulthandler's must not pass it to each other for ever.
    name = new_name()
    try:
        ended = subprocess.run(
            [sys.executable, "-c", BUS_ERROR, name, how, str(tmp_path / "file")],
            stderr=subprocess.PIPE,
            timeout=20,
            check=False,
        )
    finally:
        for number in (1, 2):
            segment_path(f"{name}-{number}").unlink(missing_ok=True)
    assert ended.returncode == -signal.SIGBUS
    assert ended.stderr.count(b"Fatal Python error") == (1 if how == "happens" else 0)


READS_SPOILED = """
import random, sys
sys.path.insert(0, sys.argv[2])
from sharing import links
import numpy as np
from tf2_ros import Buffer, SharedBufferError
from tf2_py import TransformException
print("up", flush=True)
for line in sys.stdin:
    try:
        reader = Buffer(attach=sys.argv[1])
        print("attached", flush=True)
        for _ in range(30):
            for call in (
                lambda: reader.lookup_transform_core("map", "f4", 0),
                lambda: reader.lookup_transform_core("f4", "map", 10**9 + 5),
                lambda: reader.lookup_transform_core("map", "other", 10**9 + 5),
                lambda: reader.lookup_transforms("map", "f4", np.arange(10**9, 2 * 10**9, 10**7)),
                lambda: reader.can_transform_core("map", "nowhere", 0),
                reader.all_frames_as_yaml, reader.tree, reader.statistics, reader.__getstate__,
            ):
                try:
                    call()
                except (TransformException, ValueError):
                    pass
        wait = reader._wait("map", "nowhere", 5)
        reader._follow(0.0, [])
        reader._leave()
        reader._self_check()
        reader.set_transforms(links(10**15, 0), "me")
        reader._self_check()
    except SharedBufferError as error:
        print("refused", flush=True)
    print("read", flush=True)
"""


@pytest.mark.parametrize("seed", range(6))
def test_a_spoiled_file_does_no_harm_to_readers(seed):
    # Somebody of this user writes at random into it, while it is read.
    chance = random.Random(seed)
    tests = str(Path(__file__).resolve().parent)
    with Owner() as owner:
        for ns in range(S, 2 * S, S // 50):
            owner.tell("insert", ns, 0)
        owner.tell("static", "f2", "other")
        size = owner.path.stat().st_size
        names, rings = size // 16 * NAMES_SIXTEENTH, size // 16 * RINGS_SIXTEENTH
        places = [(24, 512), (ROWS_AT, ROWS_AT + 64 * 8), (rings, rings + 2**15)] * 3
        places += [(names, names + 64)]
        with open(owner.path, "r+b", buffering=0) as file:
            whole = {start: os.pread(file.fileno(), 2**15, start) for start in (0, ROWS_AT, names, rings)}
            reads = subprocess.Popen(
                [sys.executable, "-c", READS_SPOILED, owner.name, tests],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            try:
                assert reads.stdout.readline() == "up\n"
                attached = 0
                for _ in range(40):
                    for start, data in whole.items():
                        os.pwrite(file.fileno(), data, start)
                    if chance.random() < 0.5:
                        _spoil(file, chance, places)
                    reads.stdin.write("go\n")
                    reads.stdin.flush()
                    line = reads.stdout.readline()
                    while line == "attached\n":
                        attached += 1
                        for _ in range(20):
                            _spoil(file, chance, places)
                            threading.Event().wait(0.0005)
                        line = reads.stdout.readline()
                    if line == "refused\n":
                        line = reads.stdout.readline()
                    assert line == "read\n", f"{line!r}: it ended with {reads.wait(DEADLINE_S)}"
                assert attached > 15
            finally:
                reads.kill()
                reads.communicate()


def test_a_spoiled_number_of_frames_takes_no_memory():
    with Owner() as owner:
        owner.tell("static", "f2", "other")
        reader = Buffer(attach=owner.name)
        with open(owner.path, "r+b", buffering=0) as file:
            before = os.fstat(file.fileno()).st_blocks
            owner.tell("static", "f2", "another")
            os.pwrite(file.fileno(), struct.pack("<I", 2**24), FRAMES_AT)
            assert reader.can_transform_core("f2", "other", 0)[0]
            # What is read beyond what the owner wrote becomes memory, in blocks of 512 bytes.
            assert (os.fstat(file.fileno()).st_blocks - before) * 512 < 2**20
        assert reader._why_left == "it tells of more frames than names"
        reader._self_check()


def _spoil(file, chance, places):
    for _ in range(chance.randrange(1, 4)):
        where = chance.randrange(*chance.choice(places))
        kind = chance.random()
        if kind < 0.4:
            edges = [0, 1, 2**31, 2**32 - 1, chance.getrandbits(32), chance.randrange(64)]
            data = struct.pack("<I", chance.choice(edges))
        elif kind < 0.8:
            edges = [0, 2**63, 2**64 - 1, chance.getrandbits(64), chance.getrandbits(40)]
            data = struct.pack("<Q", chance.choice(edges))
            where = where // 8 * 8
        else:
            data = chance.randbytes(chance.randrange(1, 40))
        os.pwrite(file.fileno(), data, where)


def test_sixty_four_readers():
    code = (
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from sharing import is_sound\n"
        "from tf2_ros import Buffer\n"
        "b = Buffer(attach=sys.argv[1]); n = 0\n"
        "f = b.wait_for_transform_async('map', 'late', 0)\n"
        # If this test is killed, they end, too.
        "while b._is_attached and not is_sound(b, 1000 * 10**9): pass\n"
        "print('reads', flush=True)\n"
        "while b._is_attached and not (n and f.done()): n += is_sound(b, 1000 * 10**9, (0, 10**8))\n"
        "print(n > 0, b._is_attached)"
    )
    tests = str(Path(__file__).resolve().parent)
    with Owner() as owner:
        owner.tell("run", 100, 100)
        several = []
        try:
            for _ in range(64):
                several.append(
                    subprocess.Popen(
                        [sys.executable, "-c", code, owner.name, tests], stdout=subprocess.PIPE, text=True
                    )
                )
            assert all(one.stdout.readline() == "reads\n" for one in several)
            owner.tell("static", "map", "late")
            # They share the cores.
            said = [one.communicate(timeout=150)[0] for one in several]
        finally:
            for one in several:
                one.kill()
                one.communicate()
    assert said == ["True True\n"] * 64


def test_the_limit_of_bytes_is_that_of_any_buffer():
    with Owner("max_bytes=200000") as owner:
        (accepted,) = owner.tell("frames", 5000)
        reader = Buffer(attach=owner.name)
        found = reader.statistics()
        assert found["refused"]["too_many_bytes"] == 5000 - int(accepted) > 1000
        # The table of names doubles once more, as in any buffer.
        assert found["bytes"] < 300000
        assert reader.can_transform_core("map", f"extra_{int(accepted) - 1}", 0)[0]
        reader._self_check()
        reader._leave()
        reader._self_check()


@pytest.mark.skipif(os.geteuid() != 0, reason="it takes a superuser to mount a file system")
def test_memory_that_ends_before_the_limit_does():
    # A small /dev/shm, in a mount namespace of its own.
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from making import S, transform\n"
        "from tf2_ros import Buffer\n"
        "b = Buffer(share='small'); r = Buffer(attach='small')\n"
        "n = b.set_transforms([transform('map', f'f{i}', ns=S) for i in range(20000)], 'me')\n"
        "assert 1000 < n < 20000, n\n"
        "assert b.statistics()['refused']['too_many_bytes'] == 20000 - n, b.statistics()\n"
        "assert r.can_transform_core('map', f'f{n // 2}', 0)[0]\n"
        "b._self_check(); r._self_check(); r._leave(); r._self_check(); print('sound')"
    )
    command = 'mount -t tmpfs -o size=2m tmpfs /dev/shm || exit 77; exec "$@"'
    ended = subprocess.run(
        ["unshare", "-m", "sh", "-c", command, "sh", sys.executable, "-c", code, str(PROGRAMS.parent)],
        text=True,
        capture_output=True,
        timeout=60,
    )
    if ended.returncode in (1, 77) and "unshare" in ended.stderr + "unshare" * (ended.returncode == 77):
        pytest.skip("no file system can be mounted here")
    assert ended.stdout == "sound\n", ended.stderr


def test_a_process_that_may_have_little_address_space():
    code = (
        "import resource; from tf2_ros import Buffer\n"
        "resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))\n"
        "b = Buffer(share=__import__('sys').argv[1]); r = Buffer(attach=b._sharing.name)\n"
        "assert r._is_attached; b._sharing.close(); print('sound')"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code, new_name()], text=True, capture_output=True, timeout=60
    )
    assert ended.stdout == "sound\n", ended.stderr
    with Owner() as owner:
        code = (
            "import resource, sys; from tf2_ros import Buffer, SharedBufferError\n"
            "resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))\n"
            "try: Buffer(attach=sys.argv[1])\n"
            "except SharedBufferError as error: print(error)"
        )
        ended = subprocess.run(
            [sys.executable, "-c", code, owner.name], text=True, capture_output=True, timeout=60
        )
        assert "no address space" in ended.stdout, ended.stderr


def test_the_answer_comes_to_a_wait_in_another_process_at_once():
    with Owner() as owner:
        reader = Buffer(attach=owner.name)
        for i in range(1, 50):
            waiting = reader.wait_for_transform_async("map", f"f{LINKS - 1}", at_ns(i * S))
            owner.tell("insert", i * S, 0)
            until(waiting.done)
            assert waiting.result().transform.translation.x == LINKS * i


def test_a_program_with_closed_standard_streams_logs_nothing_into_its_shared_buffer():
    code = (
        "import os, sys; sys.path[:0] = sys.argv[2:]\n"
        "from making import transform; from tf2_ros import Buffer\n"
        "shared = Buffer(share=sys.argv[1]); shared.set_transform(transform('map', 'base', 5), 'test')\n"
        "shared.set_transform(transform('', 'refused', 5), 'test')\n"  # is logged
        "os._exit(0 if 'base' in Buffer(attach=sys.argv[1]) and Buffer(attach=sys.argv[1]).frames() else 1)"
    )
    for closed in ("2>&-", "0<&- 1>&- 2>&-"):
        command = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", code, new_name()]
        ended = subprocess.run([*command, str(PROGRAMS.parent)], timeout=60)
        assert ended.returncode == 0, closed
