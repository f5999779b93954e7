# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of what was received when, drawn from records without a node, and read again."""

import numpy as np
import pytest
from picture_samples import HOSTILE, STARTS, stream
from picture_texts import texts_of

from tf2_ros.records import RECORD
from tf2_ros_tools.common.program import RunError
from tf2_ros_tools.pictures.reception_times import NOT_YET, Row, heard_figure, heard_picture, heard_rows
from tf2_ros_tools.pictures.style import GAP, file_of

BEGIN, END = 1000.0, 1010.0


def row(name, times, delay=0.001, **how):
    times = np.asarray(times, float)
    return Row(stream(name, **how), times, np.full(len(times), delay))


def bars(figure, style=GAP):
    """What a figure shows in a style, by default gaps: row from below, begin and length."""
    found = []
    for collection in figure.axes[0].collections:
        if collection.get_hatch() != style["hatch"]:
            continue
        for path in collection.get_paths():
            box = path.get_extents()
            if box.height == 1.0 and box.width > 0.0:
                found.append((box.y0, pytest.approx(box.x0), pytest.approx(box.width)))
    return sorted(found, key=lambda one: one[0])


STEADY = BEGIN + 0.01 + 0.02 * np.arange(500)


class TestHeard:
    def test_each_row_has_its_name_parent_publisher_and_figures(self):
        texts = texts_of(heard_figure([row("odom", STEADY), row("camera", [BEGIN], static=True)], BEGIN, END))
        for text in ("odom", "below map", "50.0 Hz, /robot", "delay 1.0 ms, max 4.0 ms", "static, /robot"):
            assert text in texts
        for text in ("received", "static: received, and valid since", "gap"):
            assert text in texts

    def test_gaps_are_where_nothing_was_received_for_too_long(self):
        with_gap = STEADY[(STEADY < BEGIN + 4) | (STEADY >= BEGIN + 6)]
        rows = [row("steady", STEADY), row("with_gap", with_gap), row("stopped", STEADY[STEADY < BEGIN + 7])]
        rows.append(row("silent", [BEGIN - 1]))
        rows.append(row("slow", [BEGIN, BEGIN + 5], period=None))
        assert bars(heard_figure(rows, BEGIN, END)) == [
            (1.0, 1000.0, 10.0),
            (2.0, 1006.99, 3.01),
            (3.0, 1003.99, 2.02),
        ]

    def test_what_is_blank_at_the_beginning_is_marked_as_not_received_yet(self):
        late = STEADY[STEADY >= BEGIN + 3]
        rows = [row("steady", STEADY), row("late", late), row("fixed", [BEGIN + 4], static=True)]
        figure = heard_figure(rows, BEGIN, END)
        assert bars(figure, NOT_YET) == [(0.0, 1000.0, 4.0), (1.0, 1000.0, 3.01)]
        assert bars(figure) == []

    @pytest.mark.parametrize(
        ("span", "shown"),
        [(10.0, {"21:27:15", "21:27:20"}), (259_200.0, {"2026-11-21", "2026-11-23"})],
    )
    def test_the_axis_shows_the_times_of_the_clock(self, span, shown):
        begin = 1795210034.251
        figure = heard_figure([row("odom", begin + 0.1 * span * np.arange(11))], begin, begin + span)
        axes = figure.axes[0]
        assert shown <= set(texts_of(figure))
        assert axes.get_xlabel() == "time in UTC, from 2026-11-20 21:27:14 (1795210034.251 s)"
        assert axes.get_xlim() == pytest.approx((begin, begin + span), abs=1e-6)

    @pytest.mark.parametrize("name", [*HOSTILE, "$\\frac{$"])
    def test_a_name_is_shown_as_it_is(self, name):
        assert name in texts_of(heard_figure([row(name, STEADY)], BEGIN, END))

    def test_rows_are_made_of_records(self):
        frames = ["map", "odom", "base"]
        ns = int(BEGIN) * 10**9
        records = np.array(
            [
                (ns + 20, ns + 10, 1, 0, 0, 0, 0, 0, 0),
                (ns + 30, ns + 10, 2, 1, 0, 1, 0, 0, 0),
                (ns + 40, ns + 10, 1, 0, 1, 0, 0, 0, 0),
                (ns + 10**9, ns, 1, 0, 0, 0, 0, 0, 0),
            ],
            RECORD,
        )
        streams = [stream("odom", publisher_id=0), stream("odom", publisher_id=1, period=0.1)]
        streams.append(stream("base", "odom", static=True))
        rows = heard_rows(records, streams, frames)
        assert [one.stream for one in rows] == streams
        assert [list(one.times) for one in rows] == [
            [BEGIN + 20e-9, BEGIN + 1],
            [BEGIN + 40e-9],
            [BEGIN + 30e-9],
        ]
        assert list(rows[0].delays) == pytest.approx([10e-9, 1.0])
        assert [one.gap for one in rows] == [pytest.approx(0.2), pytest.approx(0.5), np.inf]


@pytest.mark.parametrize("kind", STARTS)
def test_a_figure_is_written_in_each_format(kind):
    assert file_of(heard_figure([row("odom", STEADY)], BEGIN, END), kind).startswith(STARTS[kind])


@pytest.mark.parametrize("refusals", [[8, 8], [8, 0], []])
def test_a_frame_that_cannot_be_drawn_is_named(refusals):
    records = np.zeros(len(refusals), RECORD)
    records["child"], records["refusals"] = 1, refusals
    with pytest.raises(RunError, match=r"^no valid transform of base was received; for a path, use --path$"):
        heard_picture(records, [], ["map", "base"], ["base"], (0.0, 1.0))
