# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Answer questions about recorded transforms."""

from __future__ import annotations

import json
import os
import sys
import warnings
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tf2_py import stored_name
from tf2_py.printable import counted, printable
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.options import (
    add_output,
    add_plot_options,
    add_topic_option,
    by_topic,
    ending_in,
    format_of,
    nanoseconds,
    non_negative_number,
    positive_number,
    refuse_plot,
)
from tf2_ros_tools.common.output import first_names, show, show_json, span, write_whole
from tf2_ros_tools.common.program import SUCCESS, Parser, RunError, UsageError, run
from tf2_ros_tools.diagnosis.check_options import add_check_options

if TYPE_CHECKING:
    from argparse import _MutuallyExclusiveGroup

    from tf2_py import Hop
    from tf2_ros_tools.diagnosis.stream_statistics import Stream
    from tf2_ros_tools.recordings.bag_loader import BagContents, Topics, Urdf, Wanted
    from tf2_ros_tools.recordings.bag_reader import Recorded, RecordedTopic
    from tf2_ros_tools.recordings.report import Report
    from tf2_ros_tools.recordings.trajectories import Trajectory

DESCRIPTION = """\
Answer questions about recorded transforms, without ROS: what a recording contains, what is wrong with it, \
and where a frame was at a given time.

A recording is a rosbag2 folder, or a file that ends in .mcap, .db3 or .bag (ROS 1). Each command has its \
own help, for example tf2_bag lookup --help.

Exit status: 0 on success; 1 if the command failed, or if check found problems; 2 after wrong usage."""

EXAMPLE = """\
  tf2_bag info drive.mcap
  tf2_bag lookup drive.mcap map base_link -o path.tum
  tf2_bag explain drive.mcap map base_link
  tf2_bag check drive.mcap --expect robot.yaml
  tf2_bag freeze drive.mcap -o drive.tf2"""


S = 1_000_000_000
RECORDED = "recorded"  # in place of the name of a URDF
RECORDING = "recording"  # in place of a time
JSON = "print one JSON object"  # the help of an option
# Further paragraphs of the help of commands.
KINDS_EXPLAINED = "The documentation of tf2_check explains the kinds of problems."
REWRITTEN = """\
All else is copied unchanged. Names of frames change in the fields frame_id, child_frame_id and \
parent_frame_id of all messages, by the definitions of their types in the recording. A prefix of --topic \
changes only its topic and those below its namespace.

Names after --drop, --rename and --trajectory are those of the recording. --start and --end apply to all \
topics but static and transient-local ones."""
TABLE = """\
The columns are stamp_ns, x, y, z (meters), qx, qy, qz, qw, valid (false if there is no answer; the \
numbers are then nan) and gap (seconds between the samples that a pose was interpolated from).

Exit status: 0 on success; 1 if no time has an answer, or the recording cannot be read; 2 after wrong \
usage."""


def _topics_of(options: Namespace) -> Topics:
    """Get the topics to read."""
    from tf2_ros_tools.recordings.bag_loader import TOPICS

    return TOPICS if options.topics is None else by_topic("--topic", options.topics)


def _robots_of(options: Namespace) -> dict[str, Urdf]:
    """Get the robots whose transforms are computed from joint states, by the topics with these."""
    from tf2_ros_tools.recordings.bag_loader import JOINT_STATES
    from tf2_ros_tools.urdf import load

    robots: dict[str, Urdf] = {}
    given = by_topic("--urdf", ((topic or JOINT_STATES, urdf) for topic, urdf in options.urdf))
    for topic, urdf in given.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # printed below, in one line
            robot = urdf == RECORDED or load(Path(urdf))
        robots[topic] = robot
        for problem in () if robot is True else robot.warnings:
            options.parser.warn(f"{urdf}: {problem}")
    return robots


def _heard_of(options: Namespace, **how: Any) -> BagContents:
    """Read the transforms of the recording, as :func:`_read` does, and warn of what is left out."""
    heard = _read(options, **how)
    for text in heard.warnings:
        options.parser.warn(text)
    return heard


def _read(options: Namespace, what: Wanted | None = None, **how: Any) -> BagContents:
    """Read the transforms of the recording; ``how``: arguments of ``read_contents``."""
    from tf2_ros_tools.recordings.bag_loader import read_contents

    return read_contents(options.file, what or _wanted(options), **how)


def _wanted(options: Namespace) -> Wanted:
    from tf2_ros_tools.recordings.bag_loader import wanted

    poses, robots, trajectory = (
        by_topic("--poses", options.poses),
        _robots_of(options),
        _trajectory_of(options),
    )
    return wanted(_topics_of(options), options.start, options.end, poses, robots, trajectory)


def _trajectory_of(options: Namespace) -> Trajectory | None:
    """Get the poses that correct the transforms; only some commands have the options."""
    from tf2_ros_tools.recordings.trajectories import Trajectory

    given: list[str] | None = getattr(options, "trajectory", None)
    how: dict[str, Any] = {"on_missing": "skip"}
    for name in ("columns", "times", "start"):
        if (value := getattr(options, f"trajectory_{name}", None)) is not None:
            how[name] = value
            if given is None:
                raise UsageError(f"--trajectory-{name} needs --trajectory")
    if given is None:
        return None
    path, parent, child, moving = given
    return Trajectory(path, parent, child, moving, **how)


# List the contents and the problems of a recording.


def info(options: Namespace) -> int:
    """Print the contents of a recording; return the exit status."""
    from tf2_ros_tools.diagnosis.texts import lines_of, stream_line
    from tf2_ros_tools.recordings.report import report

    contents: dict[str, Any] = {}
    headers: dict[str, str] = {}
    what = _wanted(options)

    def show_contents(recorded: Recorded) -> None:
        headers.update(_headers(what, recorded))
        topics = sorted(recorded.topics.values(), key=lambda topic: topic.name)
        size = _size_of(options.file)
        contents.update(file=options.file, bytes=size, topics=[*map(asdict, topics)])
        if not options.json:
            show(f"{options.file}: {size:,} bytes", *_contents(topics, recorded.start_ns, recorded.end_ns))

    # Before the transforms are read, because those that cannot be read end the command.
    heard = _read(options, what, on_open=show_contents)
    said = report(heard, headers=headers)
    if options.json:
        show_json({**contents, **asdict(said)})
        return SUCCESS
    show("tree:", *(f"  {line}" for line in heard.buffer.tree().splitlines()))
    show("frames:", *(f"  {stream_line(stream)}{_gap(stream)}" for stream in said.streams))
    if said.clocks_differ:
        show("stamps and log times are from different clocks, so delays are unknown")
    show(*heard.absent, *lines_of(said.findings, said.streams, _what(said, options.file)))
    return SUCCESS


def check(options: Namespace) -> int:
    """Print the problems of a recording; return the exit status."""
    from tf2_ros_tools.diagnosis.findings import expected_by
    from tf2_ros_tools.diagnosis.texts import conclude
    from tf2_ros_tools.recordings.report import LIMITS, report

    expected = expected_by(options.expect)
    limits = replace(LIMITS, min_rate=options.min_rate, max_delay=options.max_delay)
    headers: dict[str, str] = {}
    what = _wanted(options)
    heard = _read(options, what, on_open=lambda recorded: headers.update(_headers(what, recorded)))
    said = report(heard, limits, expected, headers)
    return conclude(options, said, _what(said, options.file), {"file": options.file})


def _headers(what: Wanted, recorded: Recorded) -> dict[str, str]:
    """Read the frames that messages of topics without transforms name, with the prefix of the namespace."""
    from tf2_ros_tools.recordings.header_stamps import frames_of_headers

    found = frames_of_headers(recorded, [*what.prefixes, *what.others])
    named = [(topic, what.prefix_of(topic), frame) for topic, frame in found.items() if frame]
    return {topic: f"{prefix}{frame}" for topic, prefix, frame in named if prefix is not None}


def _what(said: Report, path: str) -> str:
    from tf2_ros_tools.recordings.saved_buffers import is_saved

    lack = "; publishers were not compared, because a saved buffer has none" if is_saved(path) else ""
    return f"{counted(said.transforms, 'transform')}, {span(said.seconds)}{lack}"


def _contents(topics: Sequence[RecordedTopic], start_ns: int | None, end_ns: int | None) -> Iterator[str]:
    if start_ns is not None and end_ns is not None:
        begin, end = start_ns / S, end_ns / S
        date = datetime.fromtimestamp(begin, timezone.utc)
        length = f"{span(end - begin)} from {date:%Y-%m-%d %H:%M:%S} UTC"
        yield f"{begin:.3f} to {end:.3f} s ({length})"
    yield "topics:"
    for topic in topics:
        yield f"  {topic.name}: {topic.msgtype}, {counted(topic.count, 'message')}"


def _gap(stream: Stream) -> str:
    return "" if stream.static or stream.count < 2 else f", longest gap {span(stream.gap)}"


def _size_of(path: str) -> int:
    names = os.scandir(path) if os.path.isdir(path) else [path]
    return sum(os.path.getsize(name) for name in names if os.path.isfile(name))


# Tables.


def lookup(options: Namespace) -> int:
    """Look up, and write a table; return the exit status."""
    import numpy as np

    from tf2_py import TransformException
    from tf2_ros_tools.recordings import pose_tables

    kind = "csv" if options.output is None else format_of(options.output)
    if kind == "parquet":
        require("pyarrow", "fleet")  # before the recording is read, which may take long
    heard = _heard_of(options, at=options.at)
    target, source = options.target, options.source
    times_ns = options.times if options.at is None else heard.times_ns
    if times_ns is None:
        try:
            times_ns = pose_tables.times_when(heard, target, source, options.rate)
        except TransformException as failure:
            raise RunError(pose_tables.why_unconnected(heard, target, source, failure)) from None
    table, reasons = pose_tables.look_up_table(heard, target, [source], times_ns, options.max_gap)
    if reasons:
        raise RunError(reasons[source])
    if kind == "parquet":
        contents = pose_tables.as_parquet(table, [options.file], np.zeros(len(table), np.int64))
    else:
        contents = pose_tables.as_tum(table) if kind == "tum" else pose_tables.as_csv(table)
    if options.output is None:
        print(contents.decode(), end="")
    else:
        write_whole(options.output, contents)
        show(options.output)
    missing = len(table) - int(table.valid.sum())
    if missing:
        text = f"no answer at {missing} of {len(table)} times{', which are left out' * (kind == 'tum')}"
        why = pose_tables.why_some_are_missing(heard, target, source, table.stamps_ns)
        options.parser.warn(f"{text}{why and f': {why}'}")
    return SUCCESS


def explain(options: Namespace) -> int:
    """Print which samples the answer of a lookup is made of; return the exit status."""
    from tf2_py import TransformException
    from tf2_ros_tools.recordings import pose_tables

    heard = _heard_of(options)
    target, source = options.target, options.source
    try:
        found = heard.buffer.explain(target, source, options.at)
    except TransformException as failure:
        raise RunError(pose_tables.why_unconnected(heard, target, source, failure)) from None
    hops = [hop for hop in found.hops if hop.frame != heard.corrected]
    show(*str(found).splitlines(), *_publishers(heard, hops))
    return SUCCESS


def _publishers(heard: BagContents, hops: Sequence[Hop]) -> Iterator[str]:
    """Say who has sent the samples of each frame with several publishers."""
    import numpy as np

    from tf2_ros_tools.diagnosis.stream_statistics import taken

    records = taken(heard.records)
    for hop in hops:
        own = records[records["child"] == heard.frames.index(hop.frame)]
        every = {heard.publishers[one] for one in own["publisher"]}
        if len(every) > 1:
            # Of static samples, only the last one is kept.
            stamps = () if hop.static else (hop.older_ns, hop.newer_ns if hop.weight else hop.older_ns)
            used = own[np.isin(own["stamp_ns"], np.array(stamps, np.int64))]
            senders = {heard.publishers[one] for one in used["publisher"]} or {hop.last_authority}
            publishers = f"{len(every)} publishers, {first_names(sorted(every))}"
            samples = f"these samples are from {first_names(sorted(senders))}"
            yield f"{printable(hop.frame)} has {publishers}; {samples}"


def statics(options: Namespace) -> int:
    """Print the static transforms as a file for static_transform_publisher; return the exit status."""
    from tf2_ros_tools.recordings.bag_loader import static_transforms

    transforms, notes = static_transforms(options.file, _topics_of(options))
    for text in notes:
        options.parser.warn(text)
    for one in transforms:
        t, q = one.transform.translation, one.transform.rotation
        # JSON's quotes keep YAML from reading the name `1` or `no` as something else.
        names = {"frame_id": one.header.frame_id, "child_frame_id": one.child_frame_id}
        entries = [f"{key}: {json.dumps(name, ensure_ascii=False)}" for key, name in names.items()]
        entries += [f"{axis}: {_in_yaml(getattr(t, axis))}" for axis in "xyz"]
        entries += [f"q{axis}: {_in_yaml(getattr(q, axis))}" for axis in "xyzw"]
        show(f"- {{{', '.join(entries)}}}")
    return SUCCESS


def _in_yaml(number: float) -> str:
    """Write a float as YAML 1.1 reads one, to which ``1e-05`` is a string."""
    text = repr(number)
    return text if "." in text else text.replace("e", ".0e")


def freeze(options: Namespace) -> int:
    """Write the transforms to a file that processes map; return the exit status."""
    _heard_of(options, records=False).buffer.freeze(options.output)
    show(options.output)
    return SUCCESS


def rewrite(options: Namespace) -> int:
    """Write the recording anew; return the exit status."""
    from tf2_ros_tools.common.static_transforms import read_file
    from tf2_ros_tools.recordings.rewriting import Edits, write

    names = dict(options.rename)
    if len(names) < len(options.rename):
        raise UsageError("--rename: expected one new name of each frame, got two of one")
    what = _wanted(options)
    try:
        statics = [] if options.statics is None else read_file(options.statics)
        edits = Edits(what, statics, options.drop, names, options.prefix, options.only_transforms)
    except ValueError as refusal:
        raise UsageError(str(refusal)) from None
    for text in write(options.file, options.output, edits):
        options.parser.warn(text)
    show(options.output)
    return SUCCESS


# Pictures.


SHORTEST_S = 1.0  # of a picture; one message has no length


def tree(options: Namespace) -> int:
    """Print the tree of frames, or draw it; return the exit status."""
    from tf2_ros_tools.pictures.tree import drawn, tree_dot
    from tf2_ros_tools.recordings.report import report

    if options.output is not None:
        require("graphviz", "cli")
    heard = _heard_of(options)
    if options.output is None:
        show(*heard.buffer.tree().splitlines())
        return SUCCESS
    said = report(heard)
    dot = tree_dot(said.streams, said.findings, heard.buffer.frames(), said.end)
    kind = format_of(options.output)
    alternative = "; a file that ends in .gv does not need it"
    write_whole(options.output, dot.encode() if kind == "gv" else drawn(dot, kind, alternative))
    show(options.output)
    return SUCCESS


def plot(options: Namespace) -> int:
    """Plot receptions or a path; return the exit status."""
    from tf2_ros_tools.pictures.path import path_picture
    from tf2_ros_tools.pictures.reception_times import heard_picture
    from tf2_ros_tools.pictures.style import write_plot
    from tf2_ros_tools.recordings.report import report

    refuse_plot(options)
    if options.trajectory is not None and options.path is None:
        raise UsageError("--trajectory needs --path")
    heard = _heard_of(options, keeps_uncorrected=True)
    said = report(heard)
    if said.begin is None or said.end is None:
        raise RunError(f"{options.file} has no transforms")
    if options.path is None:
        # All static transforms are read, regardless of --start and --end.
        begin = said.begin if options.start is None else max(said.begin, options.start / S)
        end = said.end if options.end is None else min(said.end, options.end / S)
        span = (min(begin, end - SHORTEST_S), end)
        figure = heard_picture(heard.records, said.streams, heard.frames, options.frames, span)
    else:
        drawn = heard.buffer, heard.records, said.streams, heard.frames, options.path
        figure = path_picture(*drawn, before=heard.uncorrected, corrected=heard.corrected)
    name = options.output or f"{Path(options.file).absolute().stem}.png"
    write_plot(name, figure)
    show(name)
    return SUCCESS


# The commands.


def _parser() -> Parser:
    """Make the command line."""
    made = Parser("tf2_bag", DESCRIPTION, EXAMPLE, node=False)

    def add(
        name: str, work: Callable[[Namespace], int], summary: str, *examples: str, more: str = ""
    ) -> Parser:
        example = "\n".join(f"  tf2_bag {name} {one}" for one in examples)
        command = made.add_command(name, summary, example, more)
        command.set_defaults(work=work)
        return command

    command = add(
        "info",
        info,
        "print the topics of a recording, the tree, the rate and delay of each frame, and the problems",
        "drive.mcap",
    )
    _add_recording(command)
    command.add_argument("--json", action="store_true", help=JSON)
    command = add(
        "check",
        check,
        "print a line for each problem with the transforms; the exit status is 1 if there are any",
        "drive.mcap --expect robot.yaml",
        "drive.mcap --min-rate 10 --ignore stale",
        more=KINDS_EXPLAINED,
    )
    _add_recording(command)
    command.add_argument("--json", action="store_true", help=JSON)
    add_check_options(command)
    command = add(
        "lookup",
        lookup,
        "write a table of the poses of the frame SOURCE in the frame TARGET; by default, at the stamps of "
        "all dynamic transforms between the two",
        "drive.mcap map base_link > path.csv",
        "drive.mcap map lidar --at /points -o lidar.tum",
        "drive.mcap map base_link --times 1795210034.5 1795210035",
        "drive.mcap map base_link --trajectory optimized.tum map odom base_link -o corrected.tum",
        more=TABLE,
    )
    _add_recording(command)
    _add_trajectory(command)
    _add_frames(command)
    when = _add_when(command)
    summary = "look up at these times, in seconds since 1970; 0 does not mean the latest time"
    when.add_argument("--times", nargs="+", type=nanoseconds, metavar="T", help=summary)
    command.add_argument(
        "--max-gap",
        type=non_negative_number,
        metavar="S",
        help="give no answer across gaps longer than S seconds; by default, no limit",
    )
    add_output(command, "csv", "tum", "parquet", more=", instead of printing CSV")
    command = add(
        "explain",
        explain,
        "print which samples the pose of the frame SOURCE in the frame TARGET is made of, hop by hop: their "
        "stamps, the gap between them, and who sent them",
        "drive.mcap map lidar --at 1795210034.5",
    )
    _add_recording(command)
    _add_trajectory(command)
    _add_frames(command)
    summary = "the time, in seconds since 1970; by default, the latest time for which all frames have data"
    command.add_argument("--at", type=_time, default=0, metavar="S", help=summary)
    command = add(
        "statics",
        statics,
        "print the last static transform of each frame, as YAML for static_transform_publisher --file",
        "drive.mcap > transforms.yaml",
    )
    _add_file(command)
    add_topic_option(command)
    command = add(
        "tree",
        tree,
        "print the tree of frames, or draw it with topics, rates, delays and problems",
        "drive.mcap",
        "drive.mcap -o tree.svg",
    )
    _add_recording(command)
    add_output(command, "pdf", "svg", "png", "gv")
    command = add(
        "plot",
        plot,
        "plot when each frame was received, or the path of a frame from above and over time",
        "drive.mcap odom base_link -o odometry.svg",
        "drive.mcap --path map base_link -o path.svg",
    )
    _add_recording(command)
    _add_trajectory(command)
    add_plot_options(command, "the recording's name with .png, in the current folder")
    command = add(
        "freeze",
        freeze,
        "write the transforms to a frozen file; processes that open it with Buffer.open share one copy",
        "drive.mcap -o drive.tf2",
    )
    _add_recording(command)
    _add_trajectory(command)
    summary = "write this .tf2 file"
    command.add_argument("-o", "--output", metavar="FILE", type=ending_in("tf2"), required=True, help=summary)
    command = add(
        "rewrite",
        rewrite,
        "write the recording to an .mcap file, with all topics, but other transforms or names of frames",
        "drive.mcap --trajectory optimized.tum map odom base_link -o corrected.mcap",
        "drive.mcap --statics calibration.yaml -o calibrated.mcap",
        "drive.mcap --prefix robot1/ --rename map=map -o robot1.mcap",
        "drive.mcap --drop map,base_link -o one_parent.mcap",
        more=REWRITTEN,
    )
    _add_recording(command)
    _add_trajectory(command)
    _add_edits(command)
    return made


def _add_edits(command: Parser) -> None:
    """Add the options that change a recording, and the file that is written."""
    command.add_argument(
        "--statics",
        metavar="YAML",
        type=Path,
        help="add the static transforms of this file, as for static_transform_publisher --file, and leave "
        "out all recorded ones of their frames; the names are the new ones",
    )
    command.add_argument(
        "--drop",
        action="append",
        type=_dropped,
        metavar="[PARENT,]FRAME",
        default=[],
        help="leave out the transforms of this frame, or only those in PARENT; may be given several times",
    )
    command.add_argument(
        "--rename",
        action="append",
        type=_renamed,
        metavar="OLD=NEW",
        default=[],
        help="rename a frame on all topics; may be given several times",
    )
    summary = "put this in front of the names of all other frames, on all topics; --rename map=map keeps map"
    command.add_argument("--prefix", type=stored_name, default="", help=summary)
    summary = "leave out all topics but those with transforms"
    command.add_argument("--only-transforms", action="store_true", help=summary)
    summary = "write this .mcap file"
    command.add_argument(
        "-o", "--output", metavar="FILE", type=ending_in("mcap"), required=True, help=summary
    )


def _dropped(text: str) -> tuple[str | None, str]:
    parent, comma, child = text.rpartition(",")
    if not child or comma and not parent:
        raise ArgumentTypeError(f"expected FRAME or PARENT,FRAME, got {text!r}")
    return stored_name(parent) or None, stored_name(child)


def _renamed(text: str) -> tuple[str, str]:
    old, _, new = map(stored_name, text.partition("="))
    if not old or not new:
        raise ArgumentTypeError(f"expected OLD=NEW, got {text!r}")
    return old, new


def _add_recording(made: Parser) -> None:
    """Add the arguments for the recording, and for which of its transforms are read."""
    _add_file(made)
    _add_topics(made)
    for name, summary in (
        ("--start", "omit dynamic transforms recorded before this log time, in seconds since 1970"),
        ("--end", "omit dynamic transforms recorded after this log time, in seconds since 1970"),
    ):
        made.add_argument(name, type=nanoseconds, metavar="S", help=summary)


def _add_trajectory(made: Parser) -> None:
    """Add the options for the poses that correct the transforms."""
    made.add_argument(
        "--trajectory",
        nargs=4,
        metavar=("FILE", "PARENT", "CHILD", "MOVING"),
        help="correct the transforms of the frame CHILD in PARENT by poses of the frame MOVING in PARENT: a "
        "file, such as one in TUM's format or with a heading that names its columns, or a topic of the "
        "recording; poses at times at which MOVING in CHILD is unknown are left out",
    )
    summary = (
        "what all columns of the file of --trajectory are, such as 'timestamp_us - x y z qw qx qy qz ...', "
        "where - is one that is not needed, and ... are more of them"
    )
    made.add_argument("--trajectory-columns", type=_columns, metavar="NAMES", help=summary)
    summary = "the file of --trajectory is in KITTI's format; read its stamps, in seconds, from this file"
    made.add_argument("--trajectory-times", metavar="FILE", help=summary)
    summary = (
        "the stamps of these files count from a start: this time, in seconds since 1970, or "
        f"{RECORDING!r}, the first log time of the recording"
    )
    made.add_argument("--trajectory-start", type=_start, metavar="S", help=summary)


def _add_frames(made: Parser) -> None:
    for name, what in (("target", "in which the pose is given"), ("source", "whose pose it is")):
        made.add_argument(name, metavar=name.upper(), type=stored_name, help=f"the frame {what}")


def _add_file(made: Parser) -> None:
    made.add_argument("file", metavar="FILE", help="the recording")


def _add_topics(made: Parser) -> None:
    """Add the options for the topics to read."""
    add_topic_option(made)
    made.add_argument(
        "--poses",
        action="append",
        type=_poses,
        metavar="TOPIC[=PARENT,CHILD]",
        default=[],
        help="also read the poses of this topic as transforms of the frame CHILD in the frame PARENT; the "
        "frames may be omitted for nav_msgs/Odometry and geometry_msgs/TransformStamped, which contain them; "
        "may be given several times",
    )
    made.add_argument(
        "--urdf",
        action="append",
        type=_urdf,
        metavar="[TOPIC=]FILE",
        default=[],
        help="also compute joint transforms from this URDF and TOPIC (default: /joint_states); the FILE "
        f"{RECORDED!r} is the recording's robot_description; may be given several times",
    )


def _poses(text: str) -> tuple[str, tuple[str, str] | None]:
    topic, equals, frames = text.partition("=")
    parent, _, child = map(stored_name, frames.partition(","))
    if not topic or equals and not (parent and child):
        raise ArgumentTypeError(f"expected TOPIC or TOPIC=PARENT,CHILD, got {text!r}")
    return topic, (parent, child) if equals else None


def _urdf(text: str) -> tuple[str | None, str]:
    topic, equals, file = text.partition("=")
    if not topic or equals and not file:
        raise ArgumentTypeError(f"expected FILE or TOPIC=FILE, got {text!r}")
    return (topic, file) if equals else (None, text)


def _add_when(made: Parser) -> _MutuallyExclusiveGroup:
    """Add the options for the times of lookups."""
    group = made.add_mutually_exclusive_group()
    group.add_argument("--at", metavar="TOPIC", help="look up at the stamps of this topic's messages")
    summary = "look up at this rate, while all frames on the path have data"
    group.add_argument("--rate", type=positive_number, metavar="HZ", help=summary)
    return group


def _start(text: str) -> int | str:
    return RECORDING if text == RECORDING else nanoseconds(text)


def _columns(text: str) -> str:
    from tf2_ros_tools.recordings.pose_files import columns_of

    try:
        columns_of(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None
    return text


def _time(text: str) -> int:
    time_ns = nanoseconds(text)
    if time_ns == 0:
        raise ArgumentTypeError("0 is not the time of a transform; without --at, the time is the latest one")
    return time_ns


def bag(options: Namespace) -> int:
    """Do what the command says; return the exit status."""
    from tf2_py import TransformException

    try:
        status: int = options.work(options)
        return status
    except (ValueError, TransformException) as failure:
        # Of a recording, or of frames or numbers that do not fit it.
        raise RunError(str(failure)) from None


PARSER = _parser()
main = partial(run, PARSER, bag)

if __name__ == "__main__":
    sys.exit(main())
