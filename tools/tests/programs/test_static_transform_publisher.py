# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program static_transform_publisher: what it publishes, and what it refuses."""

import json
import re
import signal

import pytest
import yaml
from making_bags import Sent, Tf, drive, write_folder, write_mcap, write_ros1
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation
from starting_programs import running
from times_and_transforms import S, about_z, rotation, translation
from waiting import DEADLINE_S, until

from tf2_msgs.msg import TFMessage
from tf2_ros_tools.common.program import RunError, UsageError
from tf2_ros_tools.common.static_transforms import normalize, read_file
from tf2_ros_tools.programs import tf2_bag
from tf2_ros_tools.programs.static_transform_publisher import PARSER, transforms_of
from tf2_ros_tools.recordings.bag_loader import static_transforms

NAME = "static_transform_publisher"
FRAMES = ["--frame-id", "map", "--child-frame-id", "robot"]
EVEN_LATE = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def turned(roll, pitch, yaw):
    return tuple(Rotation.from_euler("xyz", [roll, pitch, yaw]).as_quat())


OF_A_FILE = """\
- {frame_id: map, child_frame_id: robot, x: 1, yaw: 1e-3}
- frame_id: robot
  child_frame_id: camera
  z: -.5
  qx: 1.0
  qw: 0.0
"""
# By command line: the translation and the rotation, and what the log says.
PUBLISHED = {
    "--x 1 --y -2.5E-1 --z -0.25 --qz -.6 --qw .8": (
        ((1.0, -0.25, -0.25), (0.0, 0.0, -0.6, 0.8)),
        "Spinning until stopped - publishing transform\n"
        "translation: ('1.000000', '-0.250000', '-0.250000')\n"
        "rotation: ('0.000000', '0.000000', '-0.600000', '0.800000')\n"
        "from 'map' to 'robot'\n",
    ),
    "--roll 0.3 --pitch -0.4 --yaw -1e-3": (((0, 0, 0), turned(0.3, -0.4, -1e-3)), "publishing transform"),
    # w is 1 where it is not given.
    "--qx 1": (((0, 0, 0), (0.5**0.5, 0, 0, 0.5**0.5)), "the quaternion of robot, whose length is 1.41421"),
    "1 -1e-05 3 -0.1 0.2 0.3 map robot": (((1, -1e-05, 3), turned(0.3, 0.2, -0.1)), "Old-style arguments"),
    "1 2 3 -.6 0 0 .8 map robot": (((1, 2, 3), (-0.6, 0, 0, 0.8)), "Old-style arguments are deprecated"),
    "--file transforms.yaml": (((1, 0, 0), turned(0, 0, 1e-3)), "publishing 2 transforms of transforms.yaml"),
}


@pytest.mark.parametrize("line", PUBLISHED)
def test_what_a_command_line_asks_for_is_published(line, node, executor, tmp_path):
    messages, (wanted, said) = [], PUBLISHED[line]
    (tmp_path / "transforms.yaml").write_text(OF_A_FILE)
    node.create_subscription(TFMessage, "/tf_static", messages.append, EVEN_LATE)
    names = FRAMES if line.startswith("--") and "--file" not in line else []
    with running(NAME, *line.split(), *names, cwd=tmp_path) as process:
        until(lambda: messages, executor)
        process.send_signal(signal.SIGINT)
        out, log = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, out) == (0, "") and "Traceback" not in log
    assert said in log and re.search(rf"^\[INFO\] \[[\d.]+\] \[{NAME}_\w{{16}}\]: ", log, re.MULTILINE)
    found = [(one.header.frame_id, one.child_frame_id) for one in messages[0].transforms]
    assert found == [("map", "robot"), ("robot", "camera")][: len(found)]
    moved, turn = (pytest.approx(part, abs=1e-12) for part in wanted)
    assert (translation(messages[0].transforms[0]), rotation(messages[0].transforms[0])) == (moved, turn)


@pytest.mark.parametrize(
    ("length", "accepts"), [(0.9945, False), (0.9955, True), (1.0045, True), (1.0055, False)]
)
def test_a_rotation_is_normalized_if_tf2s_buffer_would_refuse_it(length, accepts):
    """In C++, tf2 compares the square of the length with 1 ± 0.01."""
    options = PARSER.read([NAME, *FRAMES, "--qw", str(length)])
    [one] = transforms_of(options)
    assert normalize(one) == (None if accepts else pytest.approx(length))
    assert rotation(one) == pytest.approx((0, 0, 0, length if accepts else 1.0), abs=1e-12)


@pytest.mark.parametrize("line", ["--frame-id /map --child-frame-id map", "0 0 0 0 0 0 map /map"])
def test_a_frame_in_itself_is_refused_also_with_a_leading_slash(line):
    options = PARSER.read([NAME, *line.split()])
    with pytest.raises(UsageError, match="must differ, but both are 'map'"):
        transforms_of(options)


def test_a_transform_is_published_under_the_stored_names():
    options = PARSER.read([NAME, "--frame-id", "/map", "--child-frame-id", "/robot/base"])
    [one] = transforms_of(options)
    assert (one.header.frame_id, one.child_frame_id) == ("map", "robot/base")


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ("{frame_id: 5, child_frame_id: c}", "transform 2: 'frame_id': expected the name of a frame, got 5"),
        ("{frame_id: c, child_frame_id: b}", "the frame 'b' has two transforms"),
        ("{frame_id: b, child_frame_id: a}", "is its own ancestor"),
        # As in a buffer, one leading slash is not a part of a name.
        ("{frame_id: c, child_frame_id: /b}", "the frame 'b' has two transforms"),
        ("{frame_id: /b, child_frame_id: /a}", "is its own ancestor"),
        ("{frame_id: /c, child_frame_id: c}", "frame_id and child_frame_id must differ, but both are 'c'"),
        ("{frame_id: c, child_frame_id: //d}", "'child_frame_id': expected the name of a frame, got '//d'"),
        ("{frame_id: /, child_frame_id: d}", "'frame_id': expected the name of a frame, got '/'"),
        # In YAML 1.1, 8 and 90.
        ("{frame_id: c, child_frame_id: d, x: 010}", "expected a decimal number, got '010'"),
        ("{frame_id: c, child_frame_id: d, x: 1:30}", "expected a decimal number, got '1:30'"),
        ("{frame_id: c, child_frame_id: d, x: -1:30.5}", "expected a decimal number, got '-1:30.5'"),
    ],
)
def test_what_is_wrong_in_a_file_is_told_with_its_place(tmp_path, second, said):
    path = tmp_path / "transforms.yaml"
    path.write_text(f"- {{frame_id: a, child_frame_id: b}}\n- {second}")
    with pytest.raises((ValueError, UsageError), match=re.escape(said)):
        read_file(path)


# Of recordings.


def facts(one):
    return one.header.frame_id, one.child_frame_id, translation(one), rotation(one)


def in_sqlite3(path, messages):
    return write_folder(path, messages, "sqlite3")


@pytest.mark.parametrize(
    ("name", "write"), [("a.mcap", write_mcap), ("folder", in_sqlite3), ("old.bag", write_ros1)]
)
def test_all_static_transforms_of_a_recording_are_latched(name, write, node, executor, tmp_path):
    path = write(tmp_path / name, drive())  # one at its beginning, one at its end
    messages = []
    with running(NAME, "--recording", str(path)) as process:
        log = next(line for line in process.stderr if "Spinning" in line)
        node.create_subscription(TFMessage, "/tf_static", messages.append, EVEN_LATE)
        until(lambda: messages, executor)
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) == 0
    assert log.endswith(f"publishing 2 transforms of {path}\n")
    assert [facts(one) for one in messages[0].transforms] == [
        ("base", "camera", (0.3, 0.0, 0.5), pytest.approx(about_z(0.1))),
        ("base", "lidar", (0.0, 0.1, 0.7), (0.0, 0.0, 0.0, 1.0)),
    ]


def test_the_last_static_transform_of_a_frame_counts(tmp_path):
    moved = [Tf("base", "camera", S, (1.0, 0, 0)), Tf("map", "camera", S, (2.0, 0, 0))]
    # No lookup accepts the name //arm, so nobody misses it.
    sent = [Sent(S + i, "/tf_static", [one]) for i, one in enumerate([*moved, Tf("base", "//arm", S)])]
    sent.append(Sent(2 * S, "/tf", b"not read"))
    path = write_mcap(tmp_path / "a.mcap", sent)
    [one] = static_transforms(path)[0]
    assert facts(one)[:3] == ("map", "camera", (2.0, 0.0, 0.0))


def test_statics_of_tf2_bag_prints_a_file_that_can_be_published(tmp_path, capsys):
    names = [
        "base",
        "1",
        "no",
        "~",
        "a: b, {c}",
        "#",
        'it\'s "b"',
        r"\x41",
        "x\x1b[2J\x7f\u202e\n- y",
        "süß",
        "\U0001f916",
    ]
    pairs = zip(["/base_link", *names], names, strict=False)
    sent = [Tf(*pair, S, (1e-7, -0.1, 1 / 3), about_z(i)) for i, pair in enumerate(pairs)]
    recording = write_mcap(tmp_path / "a.mcap", [Sent(S, "/tf_static", sent)])
    assert tf2_bag.bag(tf2_bag.PARSER.read(["tf2_bag", "statics", str(recording)])) == 0
    (path := tmp_path / "transforms.yaml").write_text(printed := capsys.readouterr().out, encoding="utf-8")
    assert len(printed.splitlines()) == len(names) and all(map(str.isprintable, printed.splitlines()))
    recorded = [facts(one) for one in static_transforms(recording)[0]]
    assert [facts(one) for one in read_file(path)] == recorded
    assert [child for _, child, *_ in recorded] == names


def test_statics_of_tf2_bag_prints_numbers_for_every_reader_of_yaml(tmp_path, capsys):
    given = [1e-5, 1e22, -1e-17, 1.5e-7, -0.0, 1e16, 5e-324, 1.7976931348623157e308, 123456.789]
    sent = [
        Tf("base", f"f{i}", S, (one, 1.0, 0.0), (one % 1.0, 0.0, 0.0, 1.0)) for i, one in enumerate(given)
    ]
    recording = write_mcap(tmp_path / "a.mcap", [Sent(S, "/tf_static", sent)])
    assert tf2_bag.bag(tf2_bag.PARSER.read(["tf2_bag", "statics", str(recording)])) == 0
    printed = yaml.safe_load(capsys.readouterr().out)  # of YAML 1.1, as launch files are read
    assert [one["x"] for one in printed] == given
    assert {type(one[key]) for one in printed for key in ("x", "y", "z", "qx", "qy", "qz", "qw")} == {float}


def test_a_recorded_topic_gets_its_prefix(tmp_path, capsys):
    recording = write_mcap(tmp_path / "a.mcap", drive(prefix="/robot1"))
    line = ["tf2_bag", "statics", str(recording), "--topic", "/robot1/tf_static=robot1/"]
    assert tf2_bag.bag(tf2_bag.PARSER.read(line)) == 0
    frames = re.findall('frame_id: ("[^"]*")', capsys.readouterr().out)
    assert [*map(json.loads, frames)] == [f"robot1/{name}" for name in ("base", "camera", "base", "lidar")]


@pytest.mark.parametrize(
    ("topics", "parents"),
    [
        (["/robot1/tf_static=robot1/"], ["robot1/base"]),
        (["/robot2/tf_static", "/robot1/tf_static=robot1/"], ["arm", "robot1/base"]),
        (["/robot1/tf_static", "/robot1/tf"], ["base"]),
    ],
    ids=" ".join,
)
def test_recorded_topics_are_published(topics, parents, tmp_path):
    other = Sent(S, "/robot2/tf_static", [Tf("arm", "hand", S)])
    recording = write_mcap(tmp_path / "a.mcap", [*drive(prefix="/robot1"), other])
    options = [f"--topic={one}" for one in topics]
    found = transforms_of(PARSER.read([NAME, "--recording", str(recording), *options]))
    assert sorted({one.header.frame_id for one in found}) == parents


def test_topics_without_static_transforms_are_refused_with_those_that_have_some(tmp_path):
    recording = write_mcap(tmp_path / "a.mcap", drive(prefix="/robot1"))
    said = "has no static transforms on /tf_static: `--topic` reads those on /robot1/tf_static"
    with pytest.raises(RunError, match=re.escape(said)):
        transforms_of(PARSER.read([NAME, "--recording", str(recording), "--topic", "/tf_static"]))


def test_a_topic_with_two_prefixes_is_wrong_usage(tmp_path):
    recording = write_mcap(tmp_path / "a.mcap", drive())
    topics = ["--topic", "/tf_static=r/", "--topic", "/tf_static=s/"]
    with pytest.raises(UsageError, match="^--topic: expected each topic once, got /tf_static twice$"):
        transforms_of(PARSER.read([NAME, "--recording", str(recording), *topics]))


@pytest.mark.parametrize("others", [[], ["--file", "a.yaml"], ["--frame-id", "a", "--child-frame-id", "b"]])
def test_topics_are_those_of_a_recording(others):
    with pytest.raises(UsageError, match="^--topic chooses topics of a recording, which --recording names$"):
        transforms_of(PARSER.read([NAME, "--topic", "/robot1/tf_static", *others]))
