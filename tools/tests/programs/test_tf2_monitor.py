# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2_monitor, as a process of its own, beside one that broadcasts."""

import json
import re
import time

import pytest
from starting_programs import broadcasting, running
from times_and_transforms import S
from waiting import until, until_told

from tf2_ros_tools.diagnosis.stream_statistics import Stream
from tf2_ros_tools.listening.session import Report
from tf2_ros_tools.programs.tf2_monitor import _as_of_tf2

# Without the robot of the other tests.
ALONE = ("-r", "/tf:=/tf_alone", "-r", "/tf_static:=/tf_static_alone")


@pytest.fixture(scope="module")
def robot():
    with broadcasting() as process:
        yield process


def frames(report):
    return {stream["frame"]: stream for stream in report["streams"]}


def test_json_has_the_figures_of_each_frame(robot):
    with running("tf2_monitor", "--json", "--interval", "1") as process:

        def next_report():
            return json.loads(process.stdout.readline())

        def named_report():
            report = next_report()
            return all(one["publisher"] == "/fleet/robot" for one in report["streams"]) and report

        next_report()  # it has started
        until(lambda: frames(next_report()).get("base_link", {}).get("count", 0) > 50)
        report = until_told(named_report)
    found = frames(report)
    assert set(found) == {"odom", "base_link", "camera"}
    base = found["base_link"]
    assert (base["parent"], base["publisher"], base["static"]) == ("odom", "/fleet/robot", False)
    assert 1 < base["rate"] < 500  # 50 on a machine that is not busy
    assert 0 < base["delay"] < base["delay_max"] < 2
    assert 0 < base["jitter"] < 1
    assert found["camera"]["static"]
    assert {one["kind"] for one in report["findings"]} <= {"gap", "stale"}
    assert report["chain"] is None


def test_a_pipe_gets_what_scripts_for_tf2s_program_parse(robot):
    number = r"-?\d+(\.\d+)?(e[-+]\d+)?"
    figures = f"Average Delay: {number}, Max Delay: {number}"
    report = (
        "\n\n\nRESULTS: for camera to map\n"
        "Chain is: camera -> base_link -> odom -> map\n"
        f"Net delay     avg = {number}: max = {number}\n\n"
        "Frames:\n"
        f"Frame: base_link, published by /fleet/robot, {figures}\n"
        "Frame: camera, published by /fleet/robot, Average Delay: nan, Max Delay: nan\n"
        f"Frame: odom, published by /fleet/robot, {figures}\n\n"
        "All Broadcasters:\n"
        f"Node: /fleet/robot {number} Hz, {figures.replace(',', '')}\n"
    )
    nameless = report.replace("/fleet/robot", r"(/fleet/robot|[0-9a-f]+\.\.[0-9a-f]+)")
    with running("tf2_monitor", "camera", "map", "--interval", "1.5") as process:
        out = [process.stdout.readline()]
        assert out == ["Gathering data on camera -> map for 1.5 seconds...\n"]

        def is_printed(wanted):
            out.append(process.stdout.readline())
            print(out[-1], end="")  # pytest shows it if this fails
            return re.search(wanted, "".join(out))

        until(lambda: is_printed(nameless))
        until_told(lambda: is_printed(report))


def test_a_pipe_gets_problems_after_all_of_that():
    with running("tf2_monitor", "--interval", "1", "--ros-args", *ALONE) as process:
        lines = [process.stdout.readline() for _ in range(12)]
    assert "".join(lines[:-1]) == (
        "Gathering data on all frames for 1.0 second...\n\n\n\n"
        "RESULTS: for all Frames\n\nFrames:\n\nAll Broadcasters:\n\nProblems:\n"
    )
    silence = "no transform was received on /tf_alone and /tf_static_alone in ROS domain"
    assert re.fullmatch(rf"{silence} \d+\n", lines[-1])


@pytest.mark.parametrize(("end", "kinds"), [("base", set()), ("lidar", {"clocks"})])
def test_a_chain_has_the_problems_with_clocks_of_its_own_frames_only(end, kinds, peer):
    talker = peer(*ALONE)
    with running("tf2_monitor", "map", end, "--json", "--interval", "1", "--ros-args", *ALONE) as process:

        def report_after_all():
            # The stamps of the lidar are of another clock.
            talker.send(("map", "base", time.time_ns(), 0.0))
            talker.send(("map", "lidar", time.time_ns() - 7200 * S, 0.0))
            report = json.loads(process.stdout.readline())
            return report["messages"] > 6 and report["chain"]["frames"] and report

        report = until(report_after_all)
    assert {one["kind"] for one in report["findings"]} & {"clocks"} == kinds


def test_the_delay_of_a_node_is_the_mean_of_all_its_transforms():
    streams = [
        Stream(frame, "map", "/robot", 0, False, count, rate, delay, delay + 1, delay, *5 * [0.0], None)
        for frame, count, rate, delay in (("base", 9, 10.0, 0.5), ("gps", 1, 1.5, 4.5))
    ]
    lines = [*_as_of_tf2(Report(0.0, streams, [], [], None, 10))]
    assert lines[-1] == "Node: /robot 10 Hz, Average Delay: 0.9 Max Delay: 5.5"
