"""Recordings: what is loaded from every format, from which times and topics, and from broken files."""

import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing, suppress

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
    raw,
    scan,
    write_db3,
    write_folder,
    write_mcap,
    write_ros1,
    write_split,
)

from tf2_py import TransformException
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
    for i in range(at, at + size):
        data[i] ^= 0x5A
    path.write_bytes(data)


def cut(path, part):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * part)])


def check_lost(path, text):
    """However it is read, it is an error in one line."""
    for function in (bag.load, hear, flat_read):
        with pytest.raises(bag.BagError, match=text) as raised:
            function(path)
        assert "\n" not in str(raised.value)


FAULTS = {
    "empty": (lambda path: path.write_bytes(b""), "{path} is empty$"),
    "text": (
        lambda path: path.write_bytes(b"hello\n" * 99),
        "{path} is not a {suffix} file: it begins with b'hello",
    ),
    "half": (lambda path: cut(path, 0.6), "{folder}.* is broken.*; `{tool}.*` may repair it$"),
    "end": (lambda path: cut(path, 0.98), "{folder}.* is broken.*; `{tool}.*` may repair it$"),
    "middle": (
        lambda path: spoil(path, path.stat().st_size // 2, 300),
        "is broken.*; `{tool}.*` may repair it$",
    ),
}
TOOLS = {".mcap": "mcap recover", ".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
# What has neither checksums nor a structure at the place of the fault is read.
UNNOTICED = {(form, "middle") for form in ("mcap-no-chunks", "mcap-plain", "folder-mcap", "split-mcap")}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(
    "form",
    [
        *("mcap", "mcap-lz4", "mcap-zstd", "mcap-no-index", "mcap-no-chunks", "mcap-plain", "mcap-file"),
        *("db3", "db3-file", "ros1", "ros1-bz2", "ros1-lz4"),
        *("folder-mcap", "folder-sqlite3", "split-mcap", "split-sqlite3"),
    ],
)
def test_a_fault_of_a_file_is_an_error_that_names_it_and_the_tool(form, fault, tmp_path):
    if (form, fault) in UNNOTICED:
        pytest.skip("nothing there says that it is broken")
    path = FORMATS[form](tmp_path, drive(400))
    file = max(path.glob("*[3p]")) if path.is_dir() else path
    change, text = FAULTS[fault]
    change(file)
    tool = TOOLS[os.path.splitext(file.name.removesuffix(".zstd"))[1]]
    check_lost(path, text.format(folder=path, path=file, suffix=file.suffix, tool=tool))


def _without(name):
    return lambda run: (run / name).unlink()


def _lying(old, new):
    def change(run):
        file = run / "metadata.yaml"
        text = file.read_text()
        assert re.search(old, text)
        file.write_text(re.sub(old, new, text))

    return change


TIME = r"nanoseconds_since_epoch: \d+"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            _without("metadata.yaml"),
            "run is not a recording: the folder has no metadata.yaml; `ros2 bag reindex` makes",
        ),
        (
            _without("run_1.mcap"),
            "run is broken: .*files are missing: .*run_1.mcap.*; `ros2 bag reindex` may repair",
        ),
        (_lying(r"(?s)^.*$", "{"), "run is broken: .*; `ros2 bag reindex` may repair"),
        (_lying(r"(?s)^.*$", ""), "run is broken: "),
        (_lying(r"version: \d+", "version: 99"), "run is broken: "),
        (_lying(TIME, "nanoseconds_since_epoch: .nan"), "run is broken: "),
        (_lying(TIME, "nanoseconds_since_epoch: 1.5"), "run is broken: it contains the log time 1.5 ns"),
        (_lying(TIME, f"nanoseconds_since_epoch: {10**20}"), f"it contains the log time {10**20} ns"),
    ],
)
def test_a_folder_whose_parts_do_not_fit_together(change, text, tmp_path):
    path = write_split(tmp_path / "run", DRIVE)
    change(path)
    check_lost(path, text)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("data = 'text'", "(a message must be|data are not|must be) bytes"),
        ("timestamp = 'text'", "run.db3 is broken, "),
        ("data = x'0001'", "run.db3, topic /tf_static, log time 104000000000 ns: malformed TFMessage"),
    ],
)
def test_a_database_with_other_values(change, text, tmp_path):
    path = write_db3(tmp_path / "run.db3", DRIVE)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f"update messages set {change} where id = (select max(id) from messages)")
    check_lost(path, text)


def test_a_spoiled_chunk_is_named_with_its_log_time(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    spoil(path, path.stat().st_size // 2)
    check_lost(path, r"run.mcap is broken, after log time \d+ ns: Chunk checksum")


@pytest.mark.parametrize("index", [True, False])
def test_log_times_that_do_not_fit_into_64_bits(index, tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [*DRIVE[:-2], DRIVE[-2]._replace(log_ns=2**63)], index=index)
    check_lost(path, "run.mcap is broken.*log time.* 9223372036854775808 ns")


@pytest.mark.parametrize("form", ["mcap-zstd", "ros1-bz2"])
def test_an_unknown_compression(form, tmp_path):
    path = FORMATS[form](tmp_path, DRIVE)
    path.write_bytes(path.read_bytes().replace(b"\4\0\0\0zstd", b"\4\0\0\0zzzz").replace(b"=bz2", b"=bzz"))
    check_lost(path, f"{path.name} is broken.*ompression '(zzzz|bzz)'")


def test_messages_without_a_stamp_are_named(tmp_path):
    good = scan(100 * S, 90 * S)
    path = write_mcap(tmp_path / "run.mcap", [good, good._replace(log_ns=101 * S, content=b"")])
    with pytest.raises(bag.BagError, match="run.mcap, topic /scan, log time 101000000000 ns: "):
        bag.stamps(path, "/scan")


def test_a_database_whose_log_was_not_merged(tmp_path):
    path = write_db3(tmp_path / "run.db3", DRIVE)
    (tmp_path / "run.db3-wal").write_bytes(b"log")
    check_lost(path, "run.db3 lacks what is in run.db3-wal: `sqlite3 run.db3 .* merges it")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("folder", "folder is not a recording: the folder has no metadata.yaml"),
        ("outer", "outer is not a recording: the folder has no metadata.yaml; inner in it is a recording"),
        ("ros1", "ros1 is not a recording: the folder has no metadata.yaml; run.bag in it is a recording"),
        ("outer/inner/metadata.yaml", "is not a recording: pass the path of its folder"),
        ("run.txt", "is not a recording: use a folder with a metadata.yaml, or .mcap, .db3, .bag"),
        ("run.bag.active", "is not a recording: its recorder did not finish: `rosbag reindex` repairs it"),
        ("pipe.mcap", "pipe.mcap is not a recording: it is a pipe or a device"),
    ],
)
def test_what_is_no_recording(name, text, tmp_path):
    for folder in ("folder", "outer", "ros1"):
        (tmp_path / folder).mkdir()
    write_folder(tmp_path / "outer" / "inner", DRIVE)
    write_ros1(tmp_path / "ros1" / "run.bag", DRIVE)
    for file in ("run.txt", "run.bag.active"):
        (tmp_path / file).write_text("text")
    os.mkfifo(tmp_path / "pipe.mcap")  # opening it would wait for ever
    check_lost(tmp_path / name, text)


def test_a_missing_file_is_no_broken_one(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"the recording does not exist: .*run.mcap"):
        bag.load(tmp_path / "run.mcap")


@pytest.mark.parametrize("form", ["mcap", "mcap-zstd", "folder-sqlite3", "ros1", "mcap-plain"])
def test_damage_anywhere_is_a_bag_error_or_does_not_matter(form, tmp_path):
    # Damage to nothing but the data can only be found where there are checksums.
    path = FORMATS[form](tmp_path, DRIVE)
    file = path / "run.db3" if path.is_dir() else path
    whole = file.read_bytes()
    for at in range(0, len(whole) - 8, len(whole) // 40):
        file.write_bytes(whole[:at] + b"\xff" * 8 + whole[at + 8 :])
        with suppress(bag.BagError):
            bag.load(path)


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
