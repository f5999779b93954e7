"""Pictures of where a frame was: what is drawn of it."""

import numpy as np
import pytest
from making_bags import S, Sent, Tf, drive, write_mcap
from test_pictures import texts_of

from tf2_ros_tools.findings import report
from tf2_ros_tools.loading import hear
from tf2_ros_tools.pictures import file_of
from tf2_ros_tools.trajectory import path_picture, trajectory_figure

pytestmark = pytest.mark.ours


class TestTrajectory:
    TIMES = np.arange(0.0, 8.0, 0.04) + 100.0
    ANGLES = 0.8 * (TIMES - 100.0)
    POSITIONS = np.stack([10 + 2 * np.cos(ANGLES), 2 * np.sin(ANGLES), np.full_like(ANGLES, 0.5)], axis=1)
    RPY = np.stack([0 * ANGLES, 0 * ANGLES, ANGLES], axis=1)

    def figure(self, **changed):
        given = {"times": self.TIMES, "positions": self.POSITIONS, "rpy": self.RPY, **changed}
        return trajectory_figure("map", "camera", **given)

    def test_shows_the_way_from_above_with_equal_scales(self):
        figure = self.figure()
        above = figure.axes[0]
        way = above.lines[0].get_xydata()
        assert np.array_equal(way, self.POSITIONS[:, :2])
        assert above.get_aspect() == 1.0
        assert above.get_xlim()[0] < 8.0 and above.get_xlim()[1] > 12.0
        assert {"camera in map", "its x axis", "first", "last"} <= set(texts_of(figure))

    def test_shows_the_components_over_time(self):
        _, upper, lower = self.figure().axes
        for axes, values in ((upper, self.POSITIONS), (lower, self.RPY)):
            for column, line in enumerate(axes.lines):
                assert line.get_xdata() == pytest.approx(self.TIMES)
                assert line.get_ydata() == pytest.approx(values[:, column])
        assert [line.get_label() for line in upper.lines] == ["x", "y", "z"]
        assert [line.get_label() for line in lower.lines] == ["roll", "pitch", "yaw"]
        assert len({line.get_linestyle() for line in upper.lines}) == 3
        assert lower.get_xlabel() == "time in s"

    def test_gaps_are_marked_on_the_path_and_over_time(self):
        positions, rpy = self.POSITIONS.copy(), self.RPY.copy()
        for begin, end in ((101.0, 102.0), (104.0, 105.0)):
            unknown = (self.TIMES > begin + 0.01) & (self.TIMES < end - 0.01)
            positions[unknown], rpy[unknown] = np.nan, np.nan
        figure = self.figure(positions=positions, rpy=rpy)
        above, upper, lower = figure.axes
        [marks] = [one for one in above.collections if one.get_label() == "gap"]
        edges = [np.argmin(np.abs(self.TIMES - edge)) for edge in (101.0, 102.0, 104.0, 105.0)]
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
    heard = hear(write_mcap(tmp_path / "run.mcap", sorted(messages, key=lambda one: one.log_ns)))
    figure = path_picture(
        heard.buffer, heard.records, report(heard).streams, heard.frames, ("/map", "camera")
    )
    times, yaw = figure.axes[2].lines[2].get_data()
    known = times[~np.isnan(yaw)]
    assert [*known[np.flatnonzero(np.diff(known) > 0.5)]] == pytest.approx([102.9])
    assert np.diff(known).max() == pytest.approx(2.1)
    # It turns by 0.1 rad in 0.1 s, ten times around.
    assert np.ptp(yaw[~np.isnan(yaw)]) == pytest.approx(9.9, abs=0.2)


class TestALongPath:
    """A circle of 5 m at 1.2 rad/s for four hours, ten times a second."""

    TIMES = 100.0 + 0.1 * np.arange(144_000)
    TURNED = 1.2 * (TIMES - 100.0)
    POSITIONS = np.stack([5 * np.cos(TURNED), 5 * np.sin(TURNED), np.zeros_like(TURNED)], axis=1)
    RPY = np.stack([0 * TURNED, 0 * TURNED, TURNED], axis=1)

    @pytest.mark.parametrize("kind", ["svg", "pdf"])
    def test_a_file_of_lines_stays_small_and_its_texts_are_texts(self, kind):
        figure = trajectory_figure("map", "base_link", self.TIMES, self.POSITIONS, self.RPY)
        written = file_of(figure, kind)
        assert len(written) < 1_000_000
        assert kind == "pdf" or b"base_link in map" in written
