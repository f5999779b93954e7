# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2_plot, as a process of its own, beside one that broadcasts."""

import re
import threading

import pytest
from picture_texts import texts_of
from starting_programs import NAMED_ROBOT, broadcasting, ended, heard, running
from times_and_transforms import S

LISTEN = ("-t", "4")
# Without the robot of the other tests.
ALONE = ("--ros-args", "-r", "/tf:=/tf_alone", "-r", "/tf_static:=/tf_static_alone")


@pytest.fixture(scope="module")
def robot():
    with broadcasting() as process:
        yield process


def test_all_frames_have_a_row(robot, tmp_path):
    status, out, err = ended("tf2_plot", *LISTEN, "-o", "heard.svg", hears=NAMED_ROBOT, cwd=tmp_path)
    assert (status, out) == (0, "heard.svg\n")
    assert "Listening to tf data for 5.5 seconds..." in err
    texts = texts_of(tmp_path / "heard.svg")
    assert [text for text in texts if text in ("odom", "base_link", "camera")] == [
        "odom",
        "camera",
        "base_link",
    ]
    assert len([text for text in texts if re.fullmatch(r"\d+\.\d Hz, /fleet/robot", text)]) == 2
    assert len([text for text in texts if re.fullmatch(r"delay \d+\.\d ms, max \d+\.\d ms", text)]) == 2
    assert "static, /fleet/robot" in texts


def test_a_way_leads_where_the_frame_was(peer, tmp_path):
    talker = peer(*ALONE[1:])
    picture = tmp_path / "way.svg"
    line = ("--path", "map", "robot", *LISTEN, "-o", str(picture), *ALONE)
    with running("tf2_plot", *line, hears=heard(robot=20)) as process:
        talker.matched(1)
        step = 0
        while process.poll() is None:
            step += 1
            transform = ("map", "robot", 100 * S + step * S // 10, 700.0 + step % 2 * 200)
            talker.send_without_subscriber(transform)
            threading.Event().wait(0.05)  # as a robot does
        out, err = process.communicate()
    assert (process.returncode, out) == (0, f"{picture}\n"), err
    ticks = [float(text) for text in texts_of(picture) if re.fullmatch(r"-?\d+(\.\d+)?", text)]
    places = {tick for tick in ticks if tick > 600.0}
    assert {700.0, 800.0, 900.0} <= places and max(places) < 1000.0
