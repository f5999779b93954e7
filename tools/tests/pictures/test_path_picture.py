# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of where a frame was: what is drawn of it."""

import numpy as np
import pytest
from making_bags import S, Sent, Tf, drive, write_mcap
from picture_texts import texts_of
from times_and_transforms import transform

from tf2_ros_tools.bag import Trajectory, load
from tf2_ros_tools.pictures.path import path_picture, trajectory_figure
from tf2_ros_tools.pictures.style import file_of
from tf2_ros_tools.recordings.bag_loader import read_contents, wanted
from tf2_ros_tools.recordings.report import report


def circle(count, step):
    """Times, positions and rotations of a camera on a circle of 2 m."""
    times = 100.0 + step * np.arange(count)
    angles = 0.8 * (times - 100.0)
    positions = np.stack([10 + 2 * np.cos(angles), 2 * np.sin(angles), np.full_like(angles, 0.5)], axis=1)
    return times, positions, np.stack([0 * angles, 0 * angles, angles], axis=1)


def test_a_path_is_shown_from_above_with_equal_scales_and_over_time():
    times, positions, rpy = circle(200, 0.04)
    figure = trajectory_figure("map", "camera", times, positions, rpy)
    above, upper, lower = figure.axes
    assert np.array_equal(above.lines[0].get_xydata(), positions[:, :2])
    assert above.get_aspect() == 1.0
    assert above.get_xlim()[0] < 8.0 and above.get_xlim()[1] > 12.0
    assert {"camera in map", "its x axis", "first", "last"} <= set(texts_of(figure))
    for axes, values, labels in ((upper, positions, ["x", "y", "z"]), (lower, rpy, ["roll", "pitch", "yaw"])):
        for column, line in enumerate(axes.lines):
            assert line.get_xdata() == pytest.approx(times)
            assert line.get_ydata() == pytest.approx(values[:, column])
        assert [line.get_label() for line in axes.lines] == labels
    assert len({line.get_linestyle() for line in upper.lines}) == 3
    assert lower.get_xlabel() == "time in s"


def test_gaps_are_marked_on_the_path_and_over_time():
    times, positions, rpy = circle(200, 0.04)
    for begin, end in ((101.0, 102.0), (104.0, 105.0)):
        unknown = (times > begin + 0.01) & (times < end - 0.01)
        positions[unknown], rpy[unknown] = np.nan, np.nan
    figure = trajectory_figure("map", "camera", times, positions, rpy)
    above, upper, lower = figure.axes
    [marks] = [one for one in above.collections if one.get_label() == "gap"]
    edges = [np.argmin(np.abs(times - edge)) for edge in (101.0, 102.0, 104.0, 105.0)]
    assert np.concatenate(marks.get_segments()) == pytest.approx(positions[edges, :2])
    for axes in (upper, lower):
        [bars] = axes.collections
        spans = [path.get_extents().intervalx for path in bars.get_paths()]
        assert np.concatenate(spans) == pytest.approx([101.0, 102.0, 104.0, 105.0])
    # No other line crosses a gap.
    for line in (above.lines[0], *upper.lines, *lower.lines):
        assert len(np.flatnonzero(np.diff(np.isnan(line.get_ydata()).astype(int)) == 1)) == 2
    assert "gap" in texts_of(figure)


def test_what_is_interpolated_in_a_gap_is_not_drawn_as_measured(tmp_path):
    # While the base is missing, the map's frame moves on, so there are lookups at times within the gap.
    messages = [one for one in drive(100) if not 103 * S < one.log_ns < 105 * S]
    messages += [Sent(ns, "/tf", [Tf("map", "odom", ns)]) for ns in range(103 * S, 105 * S, S // 10)]
    heard = read_contents(write_mcap(tmp_path / "run.mcap", sorted(messages, key=lambda one: one.log_ns)))
    figure = path_picture(
        heard.buffer, heard.records, report(heard).streams, heard.frames, ("/map", "camera")
    )
    times, yaw = figure.axes[2].lines[2].get_data()
    known = times[~np.isnan(yaw)]
    assert [*known[np.flatnonzero(np.diff(known) > 0.5)]] == pytest.approx([102.9])
    assert np.diff(known).max() == pytest.approx(2.1)
    # It turns by 0.1 rad in 0.1 s, ten times around.
    assert np.ptp(yaw[~np.isnan(yaw)]) == pytest.approx(9.9, abs=0.2)


@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_a_file_of_a_long_path_stays_small_and_its_texts_are_texts(kind):
    # Four hours, ten times a second.
    written = file_of(trajectory_figure("map", "camera", *circle(144_000, 0.1)), kind)
    assert len(written) < 1_000_000
    assert kind == "pdf" or b"camera in map" in written


def test_a_corrected_path_is_drawn_beside_the_recorded_one(tmp_path):
    """The recorded one has the gaps of all its frames, the corrected one not those of the corrected frame."""
    messages = [one for one in drive(100) if not 103 * S < one.log_ns < 105 * S]
    base = [Tf("odom", "base", 103 * S + i * S // 10, (i / 100, 5.0, 0.0)) for i in range(20)]
    messages += [Sent(one.ns, "/tf", [one]) for one in base]  # the map is not known from 103 to 105 s
    path = write_mcap(tmp_path / "run.mcap", sorted(messages, key=lambda one: one.log_ns))
    (tmp_path / "two.tum").write_text("100 0 0 0 0 0 0 1\n109.9 9 0 0 0 0 0 1\n")
    for frames, name in ((("map", "odom"), "recorded"), (("world", "map"), "recorded, in map")):
        what = wanted(trajectory=Trajectory(tmp_path / "two.tum", *frames, "base"))
        heard = read_contents(path, what, keeps_uncorrected=True)
        drawn = heard.buffer, heard.records, report(heard).streams, heard.frames, (frames[0], "base")
        figure = path_picture(*drawn, before=heard.uncorrected, corrected=heard.corrected)
        above, upper, _ = figure.axes
        assert {name, "corrected"} <= set(texts_of(figure))
        own = [line for line in above.lines if line.get_label() == name]
        old = load(path)
        [recorded], times = own, upper.lines[0].get_xdata()
        known = ~np.isnan(recorded.get_xdata())
        wanted_xy = old.lookup_transforms("map", "base", np.rint(times[known] * S).astype(np.int64))[0][:, :2]
        assert recorded.get_xydata()[known] == pytest.approx(wanted_xy, abs=1e-6)
        corrected = upper.lines[-3]
        assert np.isnan(corrected.get_ydata()).any() == (frames[1] == "map")
        assert np.isnan(recorded.get_xdata()).any()
        assert corrected.get_ydata()[[0, -1]] == pytest.approx([0.0, 9.0], abs=1e-6)


def test_nothing_is_drawn_as_recorded_if_the_frame_was_unknown(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", drive(100))
    (tmp_path / "two.tum").write_text("100 0 0 0 0 0 0 1\n109.9 9 0 0 0 0 0 1\n")
    what = wanted(trajectory=Trajectory(tmp_path / "two.tum", "world", "map", "base"))
    heard = read_contents(path, what, keeps_uncorrected=True)
    heard.buffer.set_transform_static(transform("earth", "world"), "x")
    drawn = heard.buffer, heard.records, report(heard).streams, heard.frames, ("earth", "base")
    figure = path_picture(*drawn, before=heard.uncorrected, corrected=heard.corrected)
    assert not any("recorded" in text for text in texts_of(figure))
