"""Recordings: what is loaded from every format, from which times and topics, and from broken files."""

import os
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from making_bags import (
    FORMATS,
    STRING,
    TF,
    S,
    Sent,
    Tf,
    drive,
    packed,
    raw,
    scan,
    write_db3,
    write_folder,
    write_mcap,
    write_ros1,
    write_split,
)

from tf2_py import BufferCore, TransformException
from tf2_ros.records import MessageSource, insert_messages
from tf2_ros_tools import bag
from tf2_ros_tools.loading import hear, wanted
from tf2_ros_tools.reading import is_static, open_recording, stamps_of

pytestmark = pytest.mark.ours

DRIVE = drive(40)


def flat(messages):
    """The transforms as (log time, static, parent, child, stamp, numbers)."""
    return [
        (one.log_ns, is_static(one.topic), tf.parent, tf.child, tf.ns, (*tf.xyz, *tf.xyzw))
        for one in messages
        for tf in one.content
    ]


def flat_read(path, **arguments):
    found = []
    for log_ns, static, m in bag.transforms(path, **arguments):
        stamp, t, q = m.header.stamp, m.transform.translation, m.transform.rotation
        numbers = (t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        ns = stamp.sec * S + stamp.nanosec
        found.append((log_ns, static, m.header.frame_id, m.child_frame_id, ns, numbers))
    return found


def answers(buffer, frames=("map", "odom", "base", "camera", "lidar")):
    """What a buffer says of all pairs of frames, over time; the listing of its frames."""
    times = np.arange(99 * S, 106 * S, S // 20)
    found = []
    for target in frames:
        for source in frames:
            try:
                found.append(buffer.lookup_transforms(target, source, times, on_missing="nan"))
            except TransformException as error:
                found.append(str(error))
    return found


def same(ours, theirs):
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_equal(one, other)


def filled(messages, **arguments):
    """A buffer filled message by message, without a recording."""
    from tf2_ros import Buffer

    class Span:
        nanoseconds = 2**62

    buffer = Buffer(Span())
    for one in messages:
        buffer.set_transforms_cdr(raw(one), one.topic, is_static(one.topic))
    return buffer


EXPECTED = answers(filled(DRIVE))


# Every format.


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_and_compression_loads_to_the_same_buffer(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    buffer = bag.load(path)
    same(answers(buffer), EXPECTED)
    assert buffer.statistics()["taken"] == len(flat(DRIVE))
    assert sorted(flat_read(path)) == sorted(flat(DRIVE))


@pytest.mark.parametrize("form", FORMATS)
def test_a_recording_is_heard_as_a_listener_would_have(form, tmp_path):
    heard = hear(FORMATS[form](tmp_path, DRIVE))
    read = [
        (
            int(one["received_ns"]),
            bool(one["static"]),
            heard.frames[one["parent"]],
            heard.frames[one["child"]],
            int(one["stamp_ns"]),
        )
        for one in heard.records
    ]
    assert read == [one[:5] for one in flat(DRIVE)]
    assert set(heard.publishers) == {"/tf", "/tf_static"}
    assert (heard.start_ns, heard.end_ns) == (DRIVE[0].log_ns, DRIVE[-1].log_ns)
    assert heard.problem is None
    same(answers(heard.buffer), EXPECTED)


def test_more_records_than_one_array_holds_are_kept_in_order(tmp_path):
    count = 3000
    many = [Tf("base", f"link{i}", 0) for i in range(50)]
    messages = [Sent(i, "/tf", [tf._replace(ns=i) for tf in many]) for i in range(1, count + 1)]
    heard = hear(write_mcap(tmp_path / "run.mcap", messages, chunk_size=1 << 20))
    assert len(heard.records) == count * len(many) > 1 << 17
    assert (np.diff(heard.records["received_ns"]) >= 0).all()


def test_an_mcap_without_an_index_need_not_be_in_the_order_of_log_times(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE[::-1], index=False, chunked=False)
    same(answers(bag.load(path)), EXPECTED)
    heard = hear(path)
    assert (np.diff(heard.records["received_ns"]) >= 0).all()


def test_split_files_may_overlap_in_log_time(tmp_path):
    messages = DRIVE[1::2] + DRIVE[::2]
    path = write_split(tmp_path / "run", messages)
    same(answers(bag.load(path)), EXPECTED)
    assert (np.diff(hear(path).records["received_ns"]) >= 0).all()


def test_a_path_may_be_a_str_or_a_path(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    same(answers(bag.load(str(path))), EXPECTED)
    with pytest.raises(TypeError, match="path must be a str or os.PathLike of str, not bytes"):
        bag.load(os.fsencode(path))


# What is kept.


def test_everything_is_kept_unless_a_cache_time_says_how_much(tmp_path):
    long = [Sent(i * S, "/tf", [Tf("map", "base", i * S)]) for i in range(1, 4000, 10)]
    path = write_mcap(tmp_path / "run.mcap", long)
    buffer = bag.load(path)
    assert buffer.statistics()["samples"] == len(long)

    class Minute:
        sec, nanosec = 60, 0

    for minute in (Minute(), 60, 60.0):
        assert bag.load(path, cache_time=minute).statistics()["samples"] < 10


def test_stamps_may_be_as_far_apart_as_they_can_be(tmp_path):
    stamps = [0, (2**31 - 1) * S + 999_999_999]
    messages = [Sent(i, "/tf", [Tf("map", "base", ns)]) for i, ns in enumerate(stamps)]
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", messages))
    assert buffer.statistics()["samples"] == len(stamps)


def test_no_limit_of_memory_refuses_a_transform(tmp_path, monkeypatch):
    monkeypatch.setenv("TF2_ROS_CYTHON_MAX_BYTES", "1000")
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", DRIVE))
    assert buffer.statistics()["taken"] == len(flat(DRIVE))


def test_the_authority_is_the_topic(tmp_path):
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", DRIVE))
    assert "broadcaster: '/tf_static'" in buffer.all_frames_as_yaml()
    assert "broadcaster: '/tf'\n" in buffer.all_frames_as_yaml()


def test_static_transforms_that_were_recorded_twice_are_one(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [DRIVE[0], DRIVE[0], *DRIVE])
    same(answers(bag.load(path)), EXPECTED)


def test_a_clock_that_jumped_back_loses_nothing(tmp_path):
    again = [one._replace(log_ns=one.log_ns + 100 * S) for one in drive(5, begin_ns=50 * S)]
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", DRIVE + again))
    for seconds in (50.2, 102.0):
        assert buffer.can_transform_core("map", "lidar", round(seconds * S))[0]


def test_refused_transforms_are_counted_and_the_rest_is_loaded(tmp_path):
    spoiled = Sent(101 * S, "/tf", [Tf("map", "odom", 101 * S, (float("nan"), 0, 0)), Tf("", "odom", 0)])
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", [*DRIVE, spoiled]))
    assert sum(buffer.statistics()["refused"].values()) == 2
    same(answers(buffer), EXPECTED)


# Times.


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("times")
    return [
        write_mcap(folder / "run.mcap", DRIVE),
        write_mcap(folder / "plain.mcap", DRIVE, index=False, chunked=False),
        write_folder(folder / "run", DRIVE, "sqlite3"),
        write_ros1(folder / "run.bag", DRIVE),
    ]


LOG_TIMES = st.none() | st.sampled_from([one.log_ns for one in DRIVE]) | st.integers(99 * S, 106 * S)


@given(start=LOG_TIMES, end=LOG_TIMES, which=st.integers(0, 3))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_start_and_end_limit_dynamic_transforms_alone(recorded, start, end, which):
    if start is not None and end is not None and end < start:
        with pytest.raises(ValueError, match="is before start"):
            bag.load(recorded[which], start=start, end=end)
        return

    def is_wanted(one):
        return one[1] or ((start is None or one[0] >= start) and (end is None or one[0] <= end))

    expected = sorted(filter(is_wanted, flat(DRIVE)))
    assert sorted(flat_read(recorded[which], start=start, end=end)) == expected
    assert bag.load(recorded[which], start=start, end=end).statistics()["taken"] == len(expected)
    heard = hear(recorded[which], wanted(start=start, end=end))
    assert len(heard.records) == len(expected)
    assert (np.diff(heard.records["received_ns"]) >= 0).all()


def test_a_span_may_be_all_of_64_bits(recorded):
    for path in recorded:
        assert bag.load(path, start=-(2**63), end=2**63 - 1).statistics()["taken"] == len(flat(DRIVE))
        assert bag.load(path, start=2**63 - 1).statistics()["taken"] == 2  # the static ones


def test_times_are_whatever_a_lookup_accepts(recorded):
    class Message:
        sec, nanosec = 102, 1_000_000

    counts = {
        bag.load(recorded[0], start=start).statistics()["taken"]
        for start in (Message(), 102 * S + 1_000_000, np.datetime64(102 * S + 1_000_000, "ns"))
    }
    assert counts == {2 * 20 + 2}
    with pytest.raises(TypeError, match="start"):
        bag.load(recorded[0], start=1.5)


# Topics.

TWO = sorted(
    drive(10, prefix="/robot1") + drive(10, prefix="/robot2", begin_ns=100 * S + 50),
    key=lambda one: one.log_ns,
)


@pytest.mark.parametrize("form", ["mcap", "folder-sqlite3", "ros1"])
def test_topics_of_several_robots_load_with_a_prefix_each(form, tmp_path):
    path = FORMATS[form](tmp_path, TWO)
    topics = {
        f"/{name}/{topic}": f"{name}/" for name in ("robot1", "robot2") for topic in ("tf", "tf_static")
    }
    buffer = bag.load(path, topics=topics)
    plain = bag.load(path, topics=["/robot1/tf", "/robot1/tf_static"])
    ours = answers(buffer, ("robot1/map", "robot1/camera"))
    same(ours, answers(plain, ("map", "camera")))
    assert buffer.lookup_transform_core("robot2/map", "robot2/base", 0).header.frame_id == "robot2/map"
    assert "map" not in buffer
    with pytest.raises(TransformException):
        buffer.lookup_transform_core("robot1/map", "robot2/map", 0)
    assert {heard_frame.partition("/")[0] for heard_frame in hear(path, wanted(topics)).frames} == {
        "robot1",
        "robot2",
    }


def test_a_prefix_replaces_the_slash_of_a_name_and_makes_no_name_of_none(tmp_path):
    messages = [Sent(1, "/tf", [Tf("/map", "/base", 1), Tf("map", "", 1)])]
    path = write_ros1(tmp_path / "run.bag", messages)
    buffer = bag.load(path, topics={"/tf": "r/"})
    assert buffer.statistics()["taken"] == 1
    assert "r/base" in buffer
    assert flat_read(path, topics={"/tf": "r/"})[0][2:4] == ("r/map", "r/base")
    assert flat_read(path)[0][2:4] == ("/map", "/base")


def test_a_recording_needs_not_have_all_topics(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [one for one in DRIVE if one.topic == "/tf"])
    assert bag.load(path).can_transform_core("map", "base", 0)[0]


def test_a_topic_without_messages_gives_an_empty_buffer(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [], topics=[("/tf", TF)])
    assert bag.load(path).statistics()["taken"] == 0
    assert list(bag.transforms(path)) == []
    heard = hear(path)
    assert (len(heard.records), heard.start_ns, heard.end_ns) == (0, None, None)


def test_without_any_of_the_topics_the_error_names_those_with_transforms(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", TWO)
    expected = (
        "run.mcap has no topic /tf or /tf_static; its topics with transforms: /robot1/tf, /robot1/tf_static"
    )
    with pytest.raises(bag.BagError, match=expected):
        bag.load(path)
    with pytest.raises(bag.BagError, match=expected):
        list(bag.transforms(path))


def test_a_topic_of_another_type_is_an_error(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [Sent(1, "/tf", {"data": "hello"}, STRING)])
    with pytest.raises(
        bag.BagError, match=r"run.mcap, topic /tf: its type is std_msgs/msg/String, not tf2_msgs"
    ):
        bag.load(path)


@pytest.mark.parametrize(
    ("topics", "error"),
    [
        ("/tf", (TypeError, r"topics must be several names, use \['/tf'\]")),
        ([], (ValueError, "topics must not be empty")),
        ([1], (TypeError, "topics must be names, or map names to prefixes, not int")),
        ({"/tf": None}, (TypeError, "topics must be names, or map names to prefixes, not NoneType")),
    ],
)
def test_topics_that_are_none_are_refused_at_once(topics, error, tmp_path):
    kind, text = error
    for function in (bag.load, bag.transforms):
        with pytest.raises(kind, match=text):
            function(tmp_path / "missing.mcap", topics=topics)


@pytest.mark.parametrize("form", ["mcap", "folder-sqlite3", "ros1"])
def test_stamps_of_any_topic_with_a_header_can_be_read(form, tmp_path):
    ros = 1 if form == "ros1" else 2
    scans = [scan(100 * S + i, 90 * S + 3 * i, ros=ros) for i in range(5)]
    if ros == 1:
        path = write_ros1(tmp_path / "run.bag", DRIVE[:1] + scans)
    else:
        path = FORMATS[form](tmp_path, DRIVE[:1] + scans)
    with open_recording(path) as recording:
        assert recording.topics["/scan"].count == 5
        assert stamps_of(recording, "/scan").tolist() == [90 * S + 3 * i for i in range(5)]
        assert bag.stamps(path, "/scan").tolist() == [90 * S + 3 * i for i in range(5)]
        with pytest.raises(
            bag.BagError, match="topic /scans: this topic does not exist; the topics are /scan, /tf_static"
        ):
            stamps_of(recording, "/scans")
        with pytest.raises(bag.BagError, match="TFMessage does not begin with a std_msgs/msg/Header"):
            stamps_of(recording, "/tf_static")


def test_stamps_of_a_topic_whose_definition_is_spoiled_are_an_error(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE[:1] + [scan(100 * S, 90 * S)], chunked=False)
    path.write_bytes(path.read_bytes().replace(b"float32 angle_min", b"float32 angle+min"))
    with open_recording(path) as recording:
        with pytest.raises(bag.BagError, match="run.mcap is broken, topic /scan, definition of its type: "):
            stamps_of(recording, "/scan")


# Broken recordings.


def spoil(path, at, size=60):
    data = bytearray(path.read_bytes())
    begin = at if at >= 0 else len(data) + at
    for i in range(begin, begin + size):
        data[i] ^= 0x5A
    path.write_bytes(data)


def cut(path, part):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * part)])


def check_broken(path, text, *, partly):
    """It is an error, and with partial=True a warning and `partly` of the transforms (least, most)."""
    with pytest.raises(bag.BagError, match=text):
        bag.load(path)
    with pytest.raises(bag.BagError, match=text):
        list(bag.transforms(path))
    with pytest.warns(bag.BagWarning, match=text) as caught:
        buffer = bag.load(path, partial=True)
    assert caught[0].filename == __file__
    least, most = partly
    assert least <= buffer.statistics()["taken"] <= most
    with pytest.warns(bag.BagWarning, match=text):
        assert len(list(bag.transforms(path, partial=True))) == buffer.statistics()["taken"]
    heard = hear(path, partial=True)
    assert len(heard.records) == buffer.statistics()["taken"]
    assert heard.problem


def check_lost(path, text):
    """It is an error in any case: nothing can be read."""
    for partial in (False, True):
        for function in (bag.load, hear):
            with pytest.raises(bag.BagError, match=text):
                function(path, partial=partial)


ALL = len(flat(DRIVE))
SOME = (5, ALL - 1)


@pytest.mark.parametrize("form", ["mcap", "db3", "ros1"])
def test_an_empty_file(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    path.write_bytes(b"")
    check_lost(path, rf"{path.name} is empty")


@pytest.mark.parametrize("form", ["mcap", "db3", "ros1"])
def test_a_file_of_another_kind(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    path.write_bytes(b"hello, world\n" * 100)
    check_lost(path, rf"{path.name} is not a {path.suffix} file: it begins with b'hello,")


def test_a_file_with_the_suffix_of_another_format(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE).rename(tmp_path / "run.bag")
    check_lost(path, "run.bag is not a .bag file: it is a .mcap file")


@pytest.mark.parametrize("form", ["mcap", "mcap-lz4", "mcap-zstd", "mcap-no-index", "mcap-no-chunks"])
def test_a_file_without_its_second_half(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    cut(path, 0.6)
    check_broken(path, f"{path.name} is broken: ", partly=SOME)


@pytest.mark.parametrize("form", ["ros1", "ros1-bz2"])
def test_a_ros1_file_without_its_end_needs_its_index_made_again(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    cut(path, 0.6)
    check_lost(path, "is broken: .*its end was cut off.*`rosbag reindex` repairs it")


@pytest.mark.parametrize("form", ["mcap", "mcap-plain"])
def test_a_file_without_its_end(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    cut(path, 0.999)
    check_broken(path, "run.mcap is broken: File end magic is invalid", partly=(ALL, ALL))


def test_a_compressed_file_without_its_second_half(tmp_path):
    # A compressor gives out whole blocks of 128 kB.
    path = packed(write_mcap(tmp_path / "run.mcap", drive(4000)))
    cut(path, 0.6)
    check_broken(path, f"^{path} is broken: ", partly=(100, 7000))


def test_a_compressed_file_with_a_spoiled_block(tmp_path):
    path = packed(write_mcap(tmp_path / "run.mcap", drive(4000)))
    spoil(path, path.stat().st_size // 2, 1000)
    check_broken(path, f"^{path} is broken", partly=(100, 7999))


@pytest.mark.parametrize("contents", [b"", b"hello, world\n" * 100])
def test_a_compressed_file_of_another_kind(contents, tmp_path):
    path = tmp_path / "run.mcap.zstd"
    path.write_bytes(contents)
    check_lost(path, f"^{path} is (empty|not a .zstd file: it begins with b'hello,)")


def test_a_compressed_file_of_another_kind_inside(tmp_path):
    path = packed(write_db3(tmp_path / "run.db3", DRIVE)).rename(tmp_path / "run.mcap.zstd")
    check_lost(path, f"^{path} is not a .mcap file: it is a .db3")


def test_a_saved_buffer_without_its_end_keeps_what_was_before(tmp_path):
    buffer = filled(drive(500))
    path = tmp_path / "saved.mcap"
    buffer.save(path)
    assert path.stat().st_size < 200_000
    for part, least in ((0.9, 600), (0.5, 250), (0.3, 100)):
        buffer.save(path)
        cut(path, part)
        check_broken(path, "saved.mcap is broken", partly=(least, 1001))


@pytest.mark.parametrize("form", ["db3", "folder-sqlite3"])
def test_a_database_without_its_second_half_is_lost(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    cut(path / "run.db3" if path.is_dir() else path, 0.6)
    check_lost(path, "run.db3 is broken: .*database disk image is malformed")


@pytest.mark.parametrize("form", ["mcap", "mcap-lz4", "mcap-zstd", "ros1", "ros1-bz2"])
def test_a_spoiled_chunk(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    spoil(path, path.stat().st_size // 2)
    check_broken(path, f"{path.name} is broken", partly=SOME)


def test_a_spoiled_chunk_is_named_with_topic_and_log_time(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    spoil(path, path.stat().st_size // 2)
    with pytest.raises(
        bag.BagError,
        match=r"run.mcap is broken, topic /tf, /tf_static, after log time \d+ ns: Chunk checksum",
    ):
        bag.load(path)


def test_messages_of_the_index_that_are_not_found_are_an_error(tmp_path):
    # The writer of rosbags writes no checksum. Here two messages have the number of no topic.
    path = write_folder(tmp_path / "run", DRIVE)
    file = path / "run.mcap"
    for message in (DRIVE[20], DRIVE[30]):
        spoil(file, file.read_bytes().index(raw(message)) - 22, 2)
    check_broken(path, "2 messages of its index cannot be found in it", partly=(ALL - 4, ALL - 4))


def test_an_index_of_more_messages_than_there_can_be(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    data = path.read_bytes()
    count = struct.pack("<HQ", 2, 40)  # of the channel /tf, in the statistics
    assert data.count(count) == 1
    path.write_bytes(data.replace(count, struct.pack("<HQ", 2, 2**64 - 1)))
    check_broken(path, r"after log time \d+ ns: \d+ messages of its index cannot be found", partly=(ALL, ALL))


@pytest.mark.parametrize("index", [True, False])
def test_log_times_that_do_not_fit_into_64_bits(index, tmp_path):
    messages = [*DRIVE[:-2], DRIVE[-2]._replace(log_ns=2**63)]
    path = write_mcap(tmp_path / "run.mcap", messages, index=index)
    text = "run.mcap is broken: it contains the log time 9223372036854775808 ns"
    check_broken(path, text, partly=(ALL - 3, ALL - 3))
    with open_recording(path, partial=True) as recording:
        assert recording.end_ns == DRIVE[-3].log_ns


def test_a_log_time_that_nothing_has_told_of():
    messages = [("/tf", 1, raw(DRIVE[0])), ("/tf", 2**63, raw(DRIVE[1]))]
    found = []
    with pytest.raises(ValueError, match="a log time of 9223372036854775808 ns does not fit into 64 bits"):
        insert_messages(BufferCore(), messages, [MessageSource("/tf")])
    buffer = BufferCore()
    explain = lambda error, last_ns: found.append((str(error), last_ns))  # noqa: E731
    assert insert_messages(buffer, messages, [MessageSource("/tf")], on_broken=explain) == 1
    assert found == [("a log time of 9223372036854775808 ns does not fit into 64 bits", 1)]
    assert buffer.statistics()["taken"] == 1


@pytest.mark.parametrize("told", [".nan", "1.5", "-99999999999999999999", "99999999999999999999"])
def test_a_folder_that_tells_of_impossible_times(told, tmp_path):
    path = write_folder(tmp_path / "run", DRIVE)
    text = (path / "metadata.yaml").read_text()
    lie = text.replace(f"nanoseconds_since_epoch: {DRIVE[0].log_ns}", f"nanoseconds_since_epoch: {told}")
    assert lie != text
    (path / "metadata.yaml").write_text(lie)
    check_broken(path, "run is broken: it contains the log time ", partly=(ALL, ALL))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("data = 'text'", "a message must be bytes, not str"),
        ("timestamp = 'text'", "is broken, topic /tf"),
    ],
)
def test_a_database_with_values_of_other_types(change, text, tmp_path):
    path = write_db3(tmp_path / "run.db3", DRIVE)
    database = sqlite3.connect(path)
    with database:
        database.execute(f"update messages set {change} where id = (select max(id) from messages)")
    database.close()
    for function in (bag.load, hear, flat_read):
        with pytest.raises(bag.BagError, match=text):
            function(path)


@pytest.mark.parametrize("form", ["mcap-zstd", "ros1-bz2"])
def test_an_unknown_compression(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    path.write_bytes(path.read_bytes().replace(b"\4\0\0\0zstd", b"\4\0\0\0zzzz").replace(b"=bz2", b"=bzz"))
    with pytest.raises(bag.BagError, match=f"{path.name} is broken.*ompression '(zzzz|bzz)'"):
        bag.load(path)


def test_malformed_messages_are_named_and_left_out(tmp_path):
    spoiled = [Sent(101 * S, "/tf", b"\0\1\0\0\xff\0\0\0"), Sent(102 * S, "/tf", b"")]
    path = write_mcap(tmp_path / "run.mcap", DRIVE + spoiled)
    text = "run.mcap, topic /tf, log time 101000000000 ns: malformed TFMessage: more transforms are announced"
    check_broken(path, text, partly=(ALL, ALL))
    with pytest.warns(bag.BagWarning, match="and 1 later message$"):
        bag.load(path, partial=True)


def test_messages_without_a_stamp_are_named_and_left_out(tmp_path):
    good = scan(100 * S, 90 * S)
    path = write_mcap(tmp_path / "run.mcap", [good, good._replace(log_ns=101 * S, content=b"")])
    text = "run.mcap, topic /scan, log time 101000000000 ns: "
    with pytest.raises(bag.BagError, match=text):
        bag.stamps(path, "/scan")
    with pytest.warns(bag.BagWarning, match=text):
        assert bag.stamps(path, "/scan", partial=True).tolist() == [90 * S]


def test_a_folder_whose_recorder_was_not_ended(tmp_path):
    path = write_split(tmp_path / "run", DRIVE)
    (path / "metadata.yaml").unlink()
    check_broken(path, r"run has no metadata.yaml, but run_0.mcap, .*ros2 bag reindex", partly=(ALL, ALL))
    (path / "run_2.mcap").write_bytes(b"")
    with pytest.warns(bag.BagWarning, match="no metadata.yaml.*; .*run_2.mcap is empty"):
        assert bag.load(path, partial=True).can_transform_core("map", "camera", 102 * S)[0]


def test_a_folder_with_a_missing_file(tmp_path):
    path = write_split(tmp_path / "run", DRIVE)
    (path / "run_1.mcap").unlink()
    check_broken(path, "files are missing: .*run_1.mcap", partly=SOME)


@pytest.mark.parametrize("text", ["{", "", "rosbag2_bagfile_information: {version: 99}"])
def test_a_folder_with_a_spoiled_metadata_file(text, tmp_path):
    path = write_split(tmp_path / "run", DRIVE)
    (path / "metadata.yaml").write_text(text)
    check_broken(path, "run is broken: ", partly=(ALL, ALL))


def test_a_broken_file_of_a_folder_is_named(tmp_path):
    path = write_split(tmp_path / "run", DRIVE)
    (path / "run_1.mcap").write_bytes(b"")
    check_broken(path, "run/run_1.mcap is empty", partly=SOME)


def test_a_database_whose_log_was_not_merged(tmp_path):
    path = write_db3(tmp_path / "run.db3", DRIVE)
    (tmp_path / "run.db3-wal").write_bytes(b"log")
    with pytest.raises(bag.BagError, match="run.db3 lacks what is in run.db3-wal"):
        bag.load(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("folder", "folder is not a recording: the folder has no metadata.yaml"),
        ("outer", "outer is not a recording: the folder has no metadata.yaml; inner in it is a recording"),
        ("ros1", "ros1 is not a recording: the folder has no metadata.yaml; run.bag in it is a recording"),
        ("outer/inner/metadata.yaml", "is not a recording: pass the path of its folder"),
        ("run.txt", "is not a recording: use a folder with a metadata.yaml, or .mcap, .db3, .bag"),
        ("run.bag.active", "is not a recording: its recorder did not finish: `rosbag reindex` repairs it"),
    ],
)
def test_what_is_no_recording(name, text, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "outer").mkdir()
    write_folder(tmp_path / "outer" / "inner", DRIVE)
    (tmp_path / "ros1").mkdir()
    write_ros1(tmp_path / "ros1" / "run.bag", DRIVE)
    for file in ("run.txt", "run.bag.active"):
        (tmp_path / file).write_text("text")
    check_lost(tmp_path / name, text)


@pytest.mark.parametrize("name", ["run.mcap", "run.db3", "run.bag", "run/run.mcap", "run/metadata.yaml"])
def test_a_pipe_is_no_recording_and_is_not_waited_for(name, tmp_path):
    write_folder(tmp_path / "run", DRIVE)
    pipe = tmp_path / name
    pipe.unlink(missing_ok=True)
    os.mkfifo(pipe)
    # What opens it all the same finds this, instead of waiting for ever.
    writer = os.open(pipe, os.O_RDWR)
    try:
        os.write(writer, b"text" * 1000)
        path, text = (
            tmp_path / "run" if "/" in name else pipe,
            f"{pipe.name} is not a recording: it is a pipe",
        )
        if pipe.suffix == ".yaml":
            check_broken(path, text, partly=(ALL, ALL))
        else:
            check_lost(path, text)
    finally:
        os.close(writer)


@pytest.mark.parametrize("form", ["mcap", "folder-mcap"])
def test_an_error_about_a_break_advises_to_read_in_part(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    if path.is_dir():
        (path / "metadata.yaml").unlink()
    else:
        cut(path, 0.9)
    with pytest.raises(bag.BagError, match="its recorder did not finish") as raised:
        bag.load(path)
    assert str(raised.value) == f"{raised.value.found}; the option partial reads what can be read of it"
    with pytest.warns(bag.BagWarning, match="its recorder did not finish") as caught:
        bag.load(path, partial=True)
    assert "the option partial" not in str(caught[0].message)


def test_a_break_before_the_first_message_leaves_nothing(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    cut(path, 0.05)
    with pytest.raises(bag.BagError, match="cut off\\), and nothing before that can be read$"):
        bag.load(path, partial=True)


def test_a_missing_file_is_no_broken_one(tmp_path):
    for partial in (False, True):
        with pytest.raises(FileNotFoundError, match=r"the recording does not exist: .*run.mcap"):
            bag.load(tmp_path / "run.mcap", partial=partial)


def test_a_whole_recording_read_in_part_warns_of_nothing(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        same(answers(bag.load(path, partial=True)), EXPECTED)


@pytest.mark.parametrize("form", ["mcap", "mcap-zstd", "folder-sqlite3", "ros1", "mcap-plain"])
def test_damage_anywhere_is_a_bag_error_or_does_not_matter(form, tmp_path):
    # Damage to nothing but the data can only be found where there are checksums.
    path = FORMATS[form](tmp_path, DRIVE)
    file = path / "run.db3" if path.is_dir() else path
    whole = file.read_bytes()
    for at in range(0, len(whole) - 8, len(whole) // 40):
        file.write_bytes(whole[:at] + b"\xff" * 8 + whole[at + 8 :])
        for partial in (False, True):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", bag.BagWarning)
                try:
                    bag.load(path, partial=partial)
                except bag.BagError:
                    pass


# Progress, and the end of a load.


def test_a_bar_counts_the_messages(tmp_path, capfd):
    path = write_mcap(tmp_path / "run.mcap", drive(600))
    bag.load(path, progress=True)
    assert "602/602" in capfd.readouterr().err
    bag.load(path, progress=False)
    bag.load(path)  # standard error is no terminal
    assert capfd.readouterr().err == ""


def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "tqdm.auto", None)
        bag.load(path)  # no bar is asked for
        with pytest.raises(ModuleNotFoundError, match=r"pip install 'tf2-ros-cython\[bag\]'") as raised:
            bag.load(path, progress=True)
        assert raised.value.name == "tqdm"
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(
        ModuleNotFoundError, match=r"rosbags is not installed: pip install 'tf2-ros-cython\[bag"
    ):
        bag.load(path)


INTERRUPTED = """
import sys
from tf2_ros_tools import bag
from tf2_ros_tools import loading

def told(*arguments):
    print("loading", flush=True)
    return bar(*arguments)

bar, loading.progress_bar = loading.progress_bar, told
while True:
    bag.load(sys.argv[1])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_load(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", drive(3000))
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "loading\n"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert "KeyboardInterrupt" in errors
    assert process.returncode == -signal.SIGINT


WITHOUT_ROS = """
import sys

ROS = ("rclpy", "geometry_msgs", "std_msgs", "builtin_interfaces", "tf2_msgs")

class Finder:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, path=None, target=None):
        return None if name.partition(".")[0] in ROS else self.finder.find_spec(name, path, target)

sys.meta_path[:] = map(Finder, sys.meta_path)
from tf2_ros_tools import bag
for path in sys.argv[1:]:
    found = bag.load(path).lookup_transform_core("map", "camera", 102_000_000_000)
    _, _, first = next(bag.transforms(path))
    print(found.transform.translation.z, first.child_frame_id, "rclpy" in sys.modules)
"""


def test_recordings_load_where_there_is_no_ros(tmp_path):
    forms = ("folder-sqlite3", "mcap-zstd", "ros1")
    paths = []
    for form in forms:
        (tmp_path / form).mkdir()
        paths.append(str(FORMATS[form](tmp_path / form, DRIVE)))
    printed = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS, *paths], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    assert printed.splitlines() == ["0.5 camera False"] * len(forms)


def test_a_recording_is_closed_after_an_error_and_an_abandoned_iteration(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    iterator = bag.transforms(path)
    next(iterator)
    iterator.close()
    cut(path, 0.5)
    with pytest.raises(bag.BagError):
        bag.load(path)
    if before is not None:
        assert len(os.listdir("/proc/self/fd")) == before
    shutil.rmtree(tmp_path)
