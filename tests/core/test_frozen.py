# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frozen files, and images in memory: what is opened answers as before, and bad ones are refused."""

import copy
import math
import os
import pickle
import random
import resource
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from frozen_format import FRAME, HEADER, LINE, FrozenFile
from pickles_and_copies import check_copy, filled, held, image_of
from random_runs import first_seed, times
from times_and_transforms import S, about_z, transform
from waiting import DEADLINE_S

from tf2_py import BufferCore, TransformException

pytestmark = pytest.mark.usefixtures("no_refusals_logged")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "robot.tf2"


@pytest.fixture
def buffer():
    return filled(BufferCore(20.0, max_frames=20, max_bytes=50_000))


@pytest.fixture
def file(buffer, path):
    """The frozen file of the buffer, as bytes."""
    buffer.freeze(path)
    return FrozenFile(path.read_bytes())


def replace(path, data):
    """Another file under this name, as programs write it that do not know what a frozen file is."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


def arrived(data):
    """A buffer of an image, as a pickle or copy has it."""
    buffer = BufferCore()
    buffer.__setstate__({"image": data})
    return buffer


# Answers.

NAMES = ("map", "odom", "base", "arm", "hand", "/odd", "λ")


def random_inserts(dice, count):
    """Good and refused, late, repeated and static transforms, with parents that change and close loops."""
    for _ in range(count):
        parent, child = dice.choices(NAMES, k=2)
        static = dice.random() < 0.1
        links = [
            transform(
                parent if dice.random() < 0.8 else dice.choice(NAMES),
                child,
                ns=dice.choice((0, 20 * S, 40 * S)) + dice.randrange(40),
                xyz=(dice.random(), dice.random(), -0.0),
                xyzw=about_z(dice.uniform(-4, 4)),
            )
            for _ in range(dice.choice((1, 3, 12, 70)))
        ]
        yield links, dice.choice(("slam", "ekf", "")), static


def insert_all(buffer, inserts, gone):
    for links, authority, static in inserts:
        buffer.set_transforms(links, authority, static)
    if gone is not None and gone in buffer:
        buffer.forget(gone)


def answers(buffer, times_ns):
    """Of all pairs of frames with samples at these times: numbers to the bit, or the class of the error."""
    found = {}
    histories = buffer.histories().values()
    names = sorted({name for one in histories for name in (one.frame, *one.parents)})
    for target in names:
        for source in names:
            try:
                poses = buffer.lookup_transforms(target, source, times_ns, on_missing="nan")
                found[target, source] = b"".join(array.tobytes() for array in poses)
            except TransformException as error:
                found[target, source] = type(error)
    return found


@pytest.mark.repeated
def test_random_trees_answer_the_same_frozen_opened_pickled_changed_and_copied(path):
    for seed in range(first_seed(), first_seed() + times(50, 1000)):
        dice = random.Random(seed)
        buffer = BufferCore(dice.choice((10.0, 30.0, math.inf)))
        insert_all(buffer, random_inserts(dice, dice.randrange(12)), dice.choice((None, None, *NAMES)))
        if dice.random() < 0.1:
            buffer.clear()
        times_ns = np.array([0, *(dice.choice((0, 20 * S, 40 * S)) + dice.randrange(40) for _ in range(8))])
        before, wanted = held(buffer), answers(buffer, times_ns)
        buffer.freeze(path)
        opened = BufferCore.open(path)
        pickled = pickle.loads(pickle.dumps(opened))
        copied = copy.copy(pickled)
        for one in (opened, pickled, copied):
            one._self_check()
            assert (held(one), answers(one, times_ns)) == (before, wanted), seed
        # Each of them goes on like the one that was frozen; what it shares with others stays.
        more, gone = [*random_inserts(dice, dice.randrange(1, 6))], dice.choice((None, None, *NAMES))
        for one in (buffer, pickled):
            insert_all(one, more, gone)
        after, wanted_after = held(buffer), answers(buffer, times_ns)
        for one in (pickled, pickle.loads(pickle.dumps(pickled)), copy.deepcopy(pickled)):
            one._self_check()
            assert (held(one), answers(one, times_ns)) == (after, wanted_after), seed
        for one in (opened, copied):
            assert (held(one), answers(one, times_ns)) == (before, wanted), seed
        opened.clear()
        opened._self_check()


def test_an_opened_file_can_be_frozen_again_under_its_own_name(buffer, path):
    buffer.freeze(path)
    opened = BufferCore.open(path)
    opened.set_transform(transform("map", "odom", 3.5), "x")
    opened.freeze(path)
    check_copy(BufferCore.open(path), opened)
    assert held(opened) != held(buffer)


def test_equal_buffers_have_equal_files(buffer, path):
    buffer.freeze(path)
    first = path.read_bytes()
    BufferCore.open(path).freeze(path)
    assert path.read_bytes() == first
    copy.deepcopy(buffer).freeze(path)
    assert FrozenFile(path.read_bytes()).header.sample_count == FrozenFile(first).header.sample_count


# Memory.


def large(count=2000):
    buffer = BufferCore(math.inf)
    for child in ("odom", "base"):
        buffer.set_transforms([transform("map", child, ns=ns) for ns in range(1, count + 1)], "x")
    return buffer


def test_only_changed_frames_are_in_memory_of_the_process(path):
    buffer = large()
    buffer.freeze(path)
    opened = BufferCore.open(path)
    assert opened.statistics()["samples"] == buffer.statistics()["samples"] == 4000
    assert opened.statistics()["bytes"] < 15_000
    opened.set_transform(transform("map", "base", ns=2001), "x")
    assert 72 * 2000 < opened.statistics()["bytes"] < 72 * 3200 + 15_000
    opened.clear()
    assert opened.statistics()["bytes"] < 72 * 3200 + 15_000


def test_the_limit_of_memory_is_about_changed_frames(path):
    file = FrozenFile(image_of(large()))
    file.change_header(max_bytes=100_000)  # it holds more than that
    file.renew_checksum()
    replace(path, file.data)
    opened = BufferCore.open(path)
    opened.set_transform(transform("map", "camera", 1), "x")
    opened.set_transform(transform("map", "base", ns=2001), "x")  # does not fit in memory of the process
    assert opened.statistics()["refused"]["too_many_bytes"] == 1
    assert opened.frames()["camera"].count == 1
    assert opened.frames()["base"].newest_ns == 2000
    opened._self_check()


# Pickles.


def test_the_pickle_of_an_unchanged_buffer_is_its_path(path):
    large().freeze(path)
    opened = BufferCore.open(path)
    data = pickle.dumps(opened)
    assert len(data) < 500
    assert str(path).encode() in data
    check_copy(pickle.loads(data), opened)
    assert len(pickle.dumps(pickle.loads(data))) < 500


CHANGES = {
    "insert": lambda buffer: buffer.set_transform(transform("map", "odom", ns=5000), "x"),
    "the same sample of another sender": lambda buffer: buffer.set_transform(
        transform("map", "odom", ns=2000), "y"
    ),
    "static": lambda buffer: buffer.set_transform_static(transform("map", "dock"), "x"),
    "clear": BufferCore.clear,
    "forget": lambda buffer: buffer.forget("odom"),
    "init": BufferCore.__init__,
}


@pytest.mark.parametrize("change", CHANGES)
def test_the_pickle_of_a_changed_buffer_has_its_state(change, path):
    large().freeze(path)
    opened = BufferCore.open(path)
    CHANGES[change](opened)
    assert str(path).encode() not in pickle.dumps(opened)
    check_copy(pickle.loads(pickle.dumps(opened)), opened)


def test_a_pickle_of_another_file_is_refused(buffer, path):
    buffer.freeze(path)
    data = pickle.dumps(BufferCore.open(path))
    large().freeze(path)
    with pytest.raises(ValueError, match=r"robot.tf2: it has changed since the buffer was pickled"):
        pickle.loads(data)
    path.unlink()
    with pytest.raises(FileNotFoundError, match=r"robot.tf2"):
        pickle.loads(data)
    other = copy.deepcopy(buffer)
    other.set_transform(transform("map", "odom", 3, xyz=(9, 9, 9)), "ekf")
    replacing = copy.deepcopy(buffer)
    replacing.set_transform(transform("map", "odom", 3, xyz=(8, 8, 8)), "ekf")
    other.freeze(path)
    data_of_other = pickle.dumps(BufferCore.open(path))
    replacing.freeze(path)
    with pytest.raises(ValueError, match=r"robot.tf2: it has changed since the buffer was pickled"):
        pickle.loads(data_of_other)  # the indices are equal
    buffer.freeze(path)  # the same again
    check_copy(pickle.loads(data), buffer)


@pytest.mark.parametrize("gone", [True, False])
def test_a_buffer_whose_file_is_gone_or_replaced_travels_with_its_samples(gone, buffer, path):
    buffer.freeze(path)
    opened = BufferCore.open(path)
    if gone:
        path.unlink()
    else:
        large().freeze(path)
    check_copy(opened, buffer)
    check_copy(pickle.loads(pickle.dumps(opened)), buffer)
    check_copy(copy.deepcopy(opened), buffer)


def test_unpickling_checks_the_samples_of_a_file_that_was_written_to(file, path):
    data = pickle.dumps(BufferCore.open(path))
    in_sample("odom", "d", 0, math.inf)(file)
    replace(path, file.data)
    with pytest.raises(ValueError, match="odom: sample 0: its translation"):
        pickle.loads(data)


@pytest.mark.parametrize("frozen", [None, (), ("/x", 1, 2), ("/x", 1, 2, "now"), (b"/x", 1, 2, 3)])
def test_a_state_without_a_file_is_refused(frozen, buffer):
    with pytest.raises(ValueError, match='not the state of a buffer: "frozen" must be'):
        buffer.__setstate__({"frozen": frozen})
    check_copy(buffer, filled(BufferCore(20.0, max_frames=20, max_bytes=50_000)))


# What others do to the file meanwhile.


def test_a_mapped_file_may_be_replaced_and_deleted(buffer, path):
    buffer.freeze(path)
    opened = BufferCore.open(path)
    large().freeze(path)
    path.unlink()
    check_copy(opened, buffer)
    opened._self_check()


READS_A_SHORTENED_FILE = """
import os, sys
from tf2_py import BufferCore

buffer = BufferCore.open(sys.argv[1])
os.chmod(sys.argv[1], 0o600)
os.truncate(sys.argv[1], 4096)
print("opened", flush=True)
buffer._self_check()
print("read")
"""


def test_reading_the_missing_part_of_a_shortened_file_ends_the_process(path):
    large().freeze(path)
    run = subprocess.run(
        [sys.executable, "-c", READS_A_SHORTENED_FILE, path],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert run.stdout == "opened\n"
    assert run.returncode != 0


# Writing.


def test_a_file_is_replaced_or_as_before_and_nothing_else_is_left(buffer, path):
    BufferCore().freeze(path)
    before, (limit, most) = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, most))  # as a full disk
    try:
        with pytest.raises(OSError, match="File too large") as refused:
            buffer.freeze(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    assert (refused.value.filename, path.read_bytes()) == (str(path), before)
    assert [*path.parent.iterdir()] == [path]
    buffer.freeze(os.fsencode(path))
    check_copy(BufferCore.open(os.fsencode(path)), buffer)
    assert path.stat().st_mode & 0o222 == 0
    assert [*path.parent.iterdir()] == [path]


def test_what_is_not_a_file_is_refused(buffer, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"gone.tf2"):
        BufferCore.open(tmp_path / "gone.tf2")
    with pytest.raises(FileNotFoundError):
        BufferCore.open("")
    with pytest.raises(FileNotFoundError, match=r"no folder/a.tf2"):
        buffer.freeze(tmp_path / "no folder" / "a.tf2")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "empty").touch()
    for path in (tmp_path, tmp_path / "pipe", tmp_path / "empty"):
        with pytest.raises(ValueError, match="it is not a frozen buffer"):
            BufferCore.open(path)
    for path in (5, None):
        with pytest.raises(TypeError, match="os.PathLike"):
            BufferCore.open(path)


# The format.


def test_a_file_that_ends_before_its_size_is_no_damaged_disk():
    """As one does that is shortened while it is read."""
    path = Path("/sys/kernel/uevent_seqnum")  # a page, by its size, and one number
    if not path.is_file():
        pytest.skip("this system has no sysfs")
    with pytest.raises(ValueError, match=f"^{path}: its size changed while it was being read: try again$"):
        BufferCore.open(path)


def test_a_second_reader_finds_what_the_buffer_holds(buffer, file):
    header = file.header
    assert header.magic == b"\x89TF2\r\n\x1a\n"
    assert (header.version, header.flags, header.file_bytes) == (3, 0, len(file.data))
    assert (header.cache_time_ns, header.max_bytes, header.max_frames) == (20 * S, 50_000, 20)
    assert header.sample_count == buffer.statistics()["samples"]
    assert header.checksum == file.index_checksum()
    assert header.samples_checksum == file.samples_checksum()
    assert {*file.authorities} == {"other", "ekf", "", "mount", "slow"}
    histories = buffer.histories()
    assert {file.name(i + 1) for i, frame in enumerate(file.frames) if frame.count} == histories.keys()
    for number, frame in enumerate(file.frames, start=1):
        if frame.count == 0:
            assert (frame.kind, frame.flags) == (0, 1)
            continue
        one = histories[file.name(number)]
        assert (frame.kind == 2, frame.count) == (one.static, len(one.stamps_ns))
        stamps = struct.unpack_from(f"<{frame.count}q", file.data, frame.data_start)
        assert [*stamps] == one.stamps_ns.tolist()
        for i in range(frame.count):
            *pose, parent, zero = struct.unpack_from("<7dII", file.data, frame.samples_start + 64 * i)
            assert pose == [*one.translations[i], *one.rotations[i]]
            assert (file.name(parent), zero) == (one.parents[i], 0)


@pytest.mark.repeated
def test_a_file_with_any_bit_changed_or_cut_off_anywhere_is_refused(file, path, tmp_path):
    whole = bytes(file.data)
    damaged = tmp_path / "damaged.tf2"

    def opened(data):
        damaged.write_bytes(data)
        return BufferCore.open(damaged)

    for read, text in ((opened, r"damaged\.tf2: "), (arrived, "the state of (a|the) buffer")):
        for at in range(0, len(whole), times(3, 1)):
            changed = bytearray(whole)
            changed[at] ^= 1 << at % 8
            with pytest.raises(ValueError, match=text):
                read(changed)
            with pytest.raises(ValueError, match=text):
                read(whole[:at])
        with pytest.raises(ValueError, match=f"{text}.*its size is not the one in its header"):
            read(whole + bytes(64))


def test_an_image_has_the_bytes_of_a_file(buffer, file):
    assert image_of(buffer) == file.data


def test_the_checks_leave_nothing_of_a_file_in_the_memory_of_the_process(path):
    large().freeze(path)
    opened = BufferCore.open(path)
    _, mapped = Path("/proc/self/smaps").read_text().split(f"{path}\n")
    assert "Rss:                   0 kB\n" in mapped.partition("VmFlags")[0]
    opened._self_check()


def resident_bytes():
    """Of this process, those of mapped files included."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def in_frame(name, **changes):
    return lambda file: file.change_frame(file.number(name), **changes)


def in_sample(name, code, at, *values, index=0):
    """`at`: from the beginning of the sample."""

    def change(file):
        file.change(code, file.frame(file.number(name)).samples_start + 64 * index + at, *values)

    return change


def in_stamp(name, index, value):
    return lambda file: file.change("q", file.frame(file.number(name)).data_start + 8 * index, value)


def close_a_loop(file):
    """Odom, whose child base was, becomes a child of base."""
    base, odom = file.number("base"), file.number("odom")
    for index in range(file.frame(odom).count):
        in_sample("odom", "I", 56, base, index=index)(file)
    file.change_frame(odom, newest_parent=base)


def authority_start(file):
    return HEADER.size + FRAME.size * len(file.frames)


def another_line_of_names(file):
    """A line of zeros more than the names need."""
    size = file.header.index_bytes
    file.data[size:size] = bytes(LINE)
    file.change_header(file_bytes=len(file.data), index_bytes=size + LINE)
    for number, frame in enumerate(file.frames, start=1):
        if frame.data_start:
            file.change_frame(number, data_start=frame.data_start + LINE)


FIELDS_OF_SAMPLES = (
    "authority",
    "newest_parent",
    "count",
    "parent_changes",
    "data_start",
    "oldest_ns",
    "newest_ns",
)

HOSTILE = {
    "another version of tf2-ros-cython wrote it": lambda file: file.change_header(version=2),
    "its header has an unknown flag": lambda file: file.change_header(flags=2),
    "its size is not the one in its header": lambda file: file.change_header(file_bytes=1 << 63),
    "the size of its index is wrong": lambda file: file.change_header(index_bytes=(1 << 64) - 64),
    "the size of its index is wrong ": lambda file: file.change_header(frame_count=0xFFFFFFFF),
    "the size of its index is wrong  ": lambda file: file.change_header(authority_count=0xFFFFFFFF),
    "the size of its index is wrong   ": lambda file: file.change_header(index_bytes=77),
    "its cache time or limits": lambda file: file.change_header(cache_time_ns=-1),
    "its cache time or limits ": lambda file: file.change_header(max_frames=0),
    "its header and its frames disagree on the number of samples": lambda file: file.change_header(
        sample_count=1 << 63
    ),
    "a reserved byte of its header": lambda file: file.change("I", 68, 1),
    "a reserved byte of its header ": lambda file: file.change("B", 88, 1),
    "a reserved byte of its header  ": lambda file: file.change("B", 127, 1),
    "frame 1.*its name in the index": lambda file: file.change_frame(1, name_start=(1 << 64) - 1),
    "frame 1.*its name in the index ": lambda file: file.change_frame(1, name_size=0xFFFFFFFF),
    "frame 1.*its name in the index  ": lambda file: file.change_frame(1, name_size=0),
    "frame 1.*its name in the index   ": lambda file: file.change("B", file.frame(1).name_start, 0xFF),
    "frame 1.*its name in the index    ": lambda file: file.change("B", file.frame(1).name_start, 0),
    "frame 2.*its name in the index     ": lambda file: file.change_frame(
        2, name_start=file.frame(1).name_start, name_size=file.frame(1).name_size
    ),
    "reserved or a duplicate": lambda file: file.change(
        "4s", file.frame(file.number("odom")).name_start, b"base"
    ),
    "the name of an authority": lambda file: file.change("Q", authority_start(file), 1 << 63),
    "the name of an authority ": lambda file: file.change("Q", authority_start(file), HEADER.size),
    "a reserved byte of an authority": lambda file: file.change("I", authority_start(file) + 12, 1),
    "its index does not end with names": lambda file: file.change("B", file.header.index_bytes - 1, 1),
    "its index does not end with names ": another_line_of_names,
    "frame .*, odom: its kind is unknown": in_frame("odom", kind=3),
    "frame .*, odom: its flags are unknown": in_frame("odom", flags=2),
    "frame .*, odom: it has no samples, but fields about samples": in_frame("odom", kind=0),
    **{
        f"frame .*, map: it has no samples, but fields about samples{' ' * i}": in_frame("map", **{field: 1})
        for i, field in enumerate(FIELDS_OF_SAMPLES)
    },
    "frame .*, map: its number of samples": in_frame("map", kind=1),
    "frame .*, map: it is neither a child nor a parent": in_frame("map", flags=0),
    "frame .*, odom: a reserved byte of it": in_frame("odom", reserved=1),
    "frame .*, odom: its number of samples": in_frame("odom", count=0),
    "frame .*, odom: its number of samples ": in_frame("odom", count=0xFFFFFFFF),
    "frame .*, odom: its number of samples  ": in_frame("odom", parent_changes=100),
    "frame .*, odom: it is static, but has several": in_frame("odom", kind=2),
    "frame .*, odom: its authority is not in the file": in_frame("odom", authority=77),
    "frame .*, odom: its parent is not in the file": in_frame("odom", newest_parent=0),
    "frame .*, odom: its parent is not in the file ": in_frame("odom", newest_parent=77),
    "frame .*, odom: the offset of its samples is wrong": in_frame("odom", data_start=(1 << 64) - 64),
    "frame .*, odom: the offset of its samples is wrong ": in_frame("odom", count=0x7FFFFFFF),
    "frame .*, odom: newest_ns is not": in_frame("odom", newest_ns=1),
    "frame .*, odom: oldest_ns is not": in_frame("odom", oldest_ns=1),
    "frame .*, camera: its static record": in_frame("camera", newest_ns=1),
    "frame .*, base: its parent changes are miscounted": in_frame("base", parent_changes=0),
    "frame .*, odom: its parent differs": lambda file: file.change_frame(
        file.number("odom"), newest_parent=file.number("base")
    ),
    "frame .*, odom: sample 0: its stamp does not fit": in_stamp("odom", 0, -1),
    "frame .*, odom: sample 2: its stamp is less than the stamp before it": in_stamp("odom", 2, 0),
    "frame .*, odom: sample 1: its translation": in_sample("odom", "d", 0, math.inf, index=1),
    "frame .*, odom: sample 1: its rotation is not": in_sample("odom", "d", 24, math.nan, index=1),
    "frame .*, odom: sample 0: its rotation has the wrong sign": in_sample(
        "odom", "4d", 24, 0.0, 0.0, 0.0, -1.0
    ),
    "frame .*, odom: sample 0: it has no parent": in_sample("odom", "I", 56, 0),
    "frame .*, base: sample 0: its parent is not a frame": in_sample("base", "I", 56, 1 << 31),
    "frame .*, base: sample 0: its parent is not marked": lambda file: in_sample(
        "base", "I", 56, file.number("camera")
    )(file),
    "frame .*, base: sample 0: the frame is its own parent": lambda file: in_sample(
        "base", "I", 56, file.number("base")
    )(file),
}


@pytest.mark.parametrize("why", HOSTILE)
def test_a_file_that_was_made_to_break_something_is_refused(why, buffer, file, path):
    HOSTILE[why](file)
    file.renew_checksum()
    replace(path, file.data)
    says = f"{why.rstrip()}.*: freeze the buffer again with this one"
    if "version" not in why:
        says = f"it is damaged: .*{why.rstrip()}.*; freeze the buffer again"
    with pytest.raises(ValueError, match=f"^{path}: {says}$"):
        BufferCore.open(path)
    says = "this is not the state of a buffer, or another version .*: pickle the buffer again with this one"
    if "version" not in why:
        says = f"the state of the buffer is damaged: .*{why.rstrip()}.*; pickle the buffer again"
    with pytest.raises(ValueError, match=f"^{says}$"):
        buffer.__setstate__({"image": file.data})
    check_copy(buffer, filled(BufferCore(20.0, max_frames=20, max_bytes=50_000)))


@pytest.mark.parametrize(
    "changes", [{}, {"frame_count": 1 << 30}, {"authority_count": 1}, {"index_bytes": 128}]
)
def test_a_file_of_holes_is_refused_at_once(changes, path):
    # Its header claims a terabyte, of which no byte was written.
    BufferCore().freeze(path)
    file = FrozenFile(path.read_bytes())
    file.change_header(**{"file_bytes": 1 << 40, "index_bytes": 1 << 40} | changes)
    replace(path, file.data[: HEADER.size])
    os.truncate(path, 1 << 40)
    read = resident_bytes()
    with pytest.raises(ValueError, match=r"robot.tf2: "):
        BufferCore.open(path)
    assert resident_bytes() - read < 1 << 28


def test_a_loop_is_that_of_a_buffer(file, path):
    close_a_loop(file)
    file.renew_checksum()
    replace(path, file.data)
    opened = BufferCore.open(path)
    opened._self_check()
    with pytest.raises(TransformException):
        opened.lookup_transform_core("map", "odom", 2 * S)  # when base was in odom
