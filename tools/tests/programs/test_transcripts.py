# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What programs print: each command of `transcripts/*.txt` is run, and prints what follows it there.

`…` stands for anything within a line. After the command, lines that begin with `>` are transforms that a peer
publishes as soon as the program listens (parent, child, stamp in s, x in m), `>>` those on /tf_static; `? 1`
is the exit status, which is otherwise 0. Standard output comes first, then standard error without log lines.
"""

import math
import re
import shlex
import signal
from decimal import Decimal
from pathlib import Path

import pytest
from making_bags import S, Sent, Tf, drive, scan, write_folder, write_mcap, write_ros1
from starting_programs import running
from waiting import DEADLINE_S

from tf2_ros_tools.programs import tf2_bag


def commands():
    """Each command with the lines below it."""
    for path in sorted(Path(__file__).with_name("transcripts").glob("*.txt")):
        for block in re.split(r"^\$ ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
            command, *lines = block.splitlines()
            yield pytest.param(command, lines, id=command)


@pytest.mark.parametrize(("command", "lines"), [*commands()])
def test_a_command_prints_what_its_transcript_shows(command, lines, folder, monkeypatch, peer, capfd):
    monkeypatch.chdir(folder)
    sent = [line.split() for line in lines if line.startswith(">")]
    status = next((int(line[2:]) for line in lines if line.startswith("? ")), 0)
    expected = [line for line in lines if not re.match(r">|\? \d+$", line)]
    name, *arguments = shlex.split(command)
    found = (in_this_process if name == "tf2_bag" else as_process)(name, arguments, sent, peer, capfd)
    shown = [line for line in found[1] if not line.startswith("[")]
    assert (found[0], shown) == (status, AsShown(expected)), "\n".join(shown)


class AsShown(list):
    """Equal to lines that match these."""

    def __eq__(self, lines):
        return len(self) == len(lines) and all(map(self.matches, self, lines))

    def matches(self, pattern, line):
        return re.fullmatch(".*".join(map(re.escape, pattern.split("…"))), line)


def in_this_process(name, arguments, sent, peer, capfd):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        status = tf2_bag.main([name, *arguments])
    except SystemExit as ending:
        status = ending.code
    finally:
        for number, handler in zip((signal.SIGINT, signal.SIGTERM), before, strict=True):
            signal.signal(number, handler)
    return status, "".join(capfd.readouterr()).splitlines()


def as_process(name, arguments, sent, peer, capfd):
    with running(name, *arguments) as process:
        talker = peer() if sent else None
        for mark, parent, child, stamp, x in sent:
            talker.send((parent, child, int(Decimal(stamp) * S), float(x)), static=mark == ">>")
        out, err = process.communicate(timeout=DEADLINE_S)
    # Until the transform is there, the log says from time to time what is missing.
    return process.returncode, (out if sent else out + err).splitlines()


def series(parent, child, ns, *, count=80, step_ns=S // 10, ahead_ns=0, xyz=(0.0, 0.0, 0.0)):
    stamps = [ns + i * step_ns for i in range(count)]
    return [Sent(one, "/tf", [Tf(parent, child, one + ahead_ns, xyz)]) for one in stamps]


BEGIN = 100 * S
SCANS = [scan(BEGIN + i * S // 4 + 5_000_007, BEGIN + i * S // 4 + 7) for i in range(12)]
WALL = 1_700_000_000 * S
FAULTS = [
    *series("a", "b", 101 * S),
    *series("b", "a", 101 * S),
    Sent(101 * S, "/tf_static", [Tf("sea", "boat", 0)]),
    *series("map", "twofold", 101 * S, step_ns=S // 5, count=40),
    *series("odom", "twofold", 101 * S + S // 10, step_ns=S // 5, count=40),
    *series("base", "camera", 101 * S),
    *series("base", "ahead", 101 * S, ahead_ns=S),
    *series("base", "gappy", 101 * S, count=31),
    *series("base", "gappy", 107 * S, count=20),
    *series("base", "broken", 101 * S, xyz=(math.nan, 0.0, 0.0)),
    *series("base", "gone", BEGIN, count=30),
]
# By their names: messages beside those of the robot that drives for ten seconds, its lidar among them.
DRIVES = {
    "drive": [],
    "faults": FAULTS,
    "late_discovery": [
        Sent(BEGIN + 100_000 + i, "/tf", [Tf("odom", "base", 97 * S + i * S // 10)]) for i in range(20)
    ],
    "shutdown": series("base", "arm", BEGIN, count=60),
    "recorder_stays": [scan(140 * S, 140 * S)],
}
# And recordings of their own.
OTHERS = {
    "sim": [one._replace(log_ns=one.log_ns + WALL) for one in series("map", "base", BEGIN)],
    "late_clock": series("map", "odom", 105 * S, count=60, step_ns=S // 20, ahead_ns=-5 * S),
    "gap": [one for one in drive(100) if not 103 * S < one.log_ns < 105 * S],
    "from_0": [Sent(i * S, "/tf", [Tf("map", "base", i * S, (i, 0, 0))]) for i in range(5)],
    "now": series("map", "base", 1_795_210_034 * S, count=2),
    "two": sorted([*drive(20, prefix="/one"), *drive(20, prefix="/two")], key=lambda one: one.log_ns),
    "hostile": [Sent(BEGIN, "/tf_static", [Tf("map", "base", 0), Tf("se\na", "x\x1b[2J", 0)])],
    "mount": [Sent(BEGIN, "/tf_static", [Tf("base", "camera", BEGIN)])],
    "scans": [scan(S, S)],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The current folder of all commands."""
    folder = tmp_path_factory.mktemp("transcripts")
    for name, more in DRIVES.items():
        messages = sorted([*drive(100), *SCANS, *more], key=lambda one: one.log_ns)
        write_mcap(folder / f"{name}.mcap", messages)
    for name, messages in OTHERS.items():
        write_mcap(folder / f"{name}.mcap", messages, topics=[("/scan", "sensor_msgs/msg/LaserScan")])
    write_mcap(folder / "silent.mcap", [], topics=[("/tf", "tf2_msgs/msg/TFMessage")])
    write_folder(folder / "folder", drive(30))
    write_ros1(folder / "old.bag", drive(30))
    whole = (folder / "drive.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.bag").write_bytes(b"")
    (folder / "text.txt").write_text("hello")
    (folder / "loop.mcap").symlink_to(folder / "loop.mcap")
    (folder / "healthy.yaml").write_text(
        "frames:\n"
        "  base: {parent: odom, min_rate: 9, max_delay: 0.01, static: false}\n"
        "  camera: {parent: base, static: true}\n"
    )
    (folder / "other.yaml").write_text(
        "frames:\n  base: {parent: map, min_rate: 20, max_delay: 0.0005}\n  arm:\n  lidar: {static: false}\n"
    )
    (folder / "bad.yaml").write_text("frames: 3\n")
    (folder / "message.yaml").write_text(
        "- header: {frame_id: a}\n  child_frame_id: b\n  transform: {translation: {x: 1, y: 2, z: 3}}\n"
    )
    (folder / "values.yaml").write_text("- [0, 0, 0, 0, 0, 0, a, b]")
    (folder / "parent.yaml").write_text("- {frame: a, child_frame_id: b}")
    (folder / "transforms.yaml").write_text("- {frame_id: a, child_frame_id: b, x: near}")
    return folder
