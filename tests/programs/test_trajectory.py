"""Pictures of where a frame was: what is drawn of it."""

import numpy as np
import pytest
from test_pictures import texts_of

from tf2_ros_tools.pictures import file_of
from tf2_ros_tools.trajectory import trajectory_figure

pytestmark = pytest.mark.ours


class TestTrajectory:
    TIMES = np.arange(0.0, 8.0, 0.04) + 100.0
    ANGLES = 0.8 * (TIMES - 100.0)
    POSITIONS = np.stack([10 + 2 * np.cos(ANGLES), 2 * np.sin(ANGLES), np.full_like(ANGLES, 0.5)], axis=1)
    RPY = np.stack([0 * ANGLES, 0 * ANGLES, (ANGLES + np.pi) % (2 * np.pi) - np.pi], axis=1)

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
        for axes, values in ((upper, self.POSITIONS), (lower, np.unwrap(self.RPY, axis=0))):
            for column, line in enumerate(axes.lines):
                assert line.get_xdata() == pytest.approx(self.TIMES)
                assert line.get_ydata() == pytest.approx(values[:, column])
        assert [line.get_label() for line in upper.lines] == ["x", "y", "z"]
        assert [line.get_label() for line in lower.lines] == ["roll", "pitch", "yaw"]
        assert len({line.get_linestyle() for line in upper.lines}) == 3
        assert lower.get_xlabel() == "time in s"

    def test_gaps_are_marked_on_the_path_and_over_time(self):
        """From 101 to 102, transforms are missing; from 104 to 105, positions are unknown."""
        keep = (self.TIMES <= 101.0) | (self.TIMES >= 101.99)
        times, positions, rpy = (some[keep].copy() for some in (self.TIMES, self.POSITIONS, self.RPY))
        unknown = (times > 104.01) & (times < 104.99)
        positions[unknown], rpy[unknown] = np.nan, np.nan
        figure = self.figure(times=times, positions=positions, rpy=rpy, gaps=[(101.0, 102.0)])
        above, upper, lower = figure.axes
        [marks] = [line for line in above.lines if line.get_label() == "gap"]
        edges = [np.argmin(np.abs(times - edge)) for edge in (101.0, 102.0, 104.0, 105.0)]
        drawn = marks.get_xydata()
        assert drawn[~np.isnan(drawn[:, 0])] == pytest.approx(positions[edges, :2])
        assert np.isnan(drawn[2]).all()  # from one gap to the next, nothing
        for axes in (upper, lower):
            [bars] = axes.collections
            spans = [path.get_extents().intervalx for path in bars.get_paths()]
            assert np.concatenate(spans) == pytest.approx([101.0, 102.0, 104.0, 105.0])
        # No other line crosses a gap.
        for line in (above.lines[0], *upper.lines, *lower.lines):
            assert len(np.flatnonzero(np.diff(np.isnan(line.get_ydata()).astype(int)) == 1)) == 2
        assert "gap" in texts_of(figure)

    def test_what_is_interpolated_in_a_gap_is_not_drawn_as_measured(self):
        # Another frame of the chain moved on, so there are lookups at times within the gap.
        times, x = self.figure(gaps=[(101.0, 102.0), (101.5, 103.0)]).axes[1].lines[0].get_data()
        assert times[np.isnan(x)].tolist() == [102.0]
        measured = (self.TIMES <= 101.0) | (self.TIMES >= 103.0)
        assert times[~np.isnan(x)].tolist() == self.TIMES[measured].tolist()


class TestALongPath:
    """A circle of 5 m at 1.2 rad/s for four hours, ten times a second."""

    TIMES = 100.0 + 0.1 * np.arange(144_000)
    TURNED = 1.2 * (TIMES - 100.0)
    POSITIONS = np.stack([5 * np.cos(TURNED), 5 * np.sin(TURNED), np.zeros_like(TURNED)], axis=1)
    RPY = np.stack([0 * TURNED, 0 * TURNED, (TURNED + np.pi) % (2 * np.pi) - np.pi], axis=1)

    def figure(self, **changed):
        given = {"times": self.TIMES, "positions": self.POSITIONS, "rpy": self.RPY, **changed}
        return trajectory_figure("map", "base_link", **given)

    @pytest.mark.parametrize("kind", ["svg", "pdf"])
    def test_a_file_of_lines_stays_small_and_its_texts_are_texts(self, kind):
        written = file_of(self.figure(), kind)
        assert len(written) < 1_000_000
        assert kind == "pdf" or b"base_link in map" in written
