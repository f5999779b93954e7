"""Pictures, drawn from records and arrays without a node, and read again."""

import re
import subprocess
from math import inf
from xml.etree import ElementTree

import numpy as np
import pytest
from processes import needs_dot

from tf2_ros._pictures.heard import MOST_ROWS, Heard, heard_figure, heard_rows
from tf2_ros._pictures.labels import label
from tf2_ros._pictures.plots import file_of
from tf2_ros._pictures.trajectory import trajectory_figure
from tf2_ros._pictures.tree import MOST_FINDINGS, render, tree_dot
from tf2_ros._receive.recording import RECORD
from tf2_ros._traffic.findings import Finding, Limits
from tf2_ros._traffic.streams import Stream
from tf2_ros.cli._drawing import heard_picture
from tf2_ros_cython.cli._program import RunError

pytestmark = pytest.mark.ours

SVG = "{http://www.w3.org/2000/svg}"
STARTS = {"svg": b"<?xml", "png": b"\x89PNG\r\n\x1a\n", "pdf": b"%PDF-"}
# What means something to Graphviz, to SVG, or to a terminal.
HOSTILE = [
    "a:b",
    "<b>bold</b>",
    'say "hi"',
    "back\\slash\\n\\G",
    "&amp;",
    "]; evil [",
    "-- comment",
    "subgraph",
    "$a$",
    "中文",
    "<",
]


def stream(frame, parent="map", publisher="/robot", static=False, **figures):
    timed = {} if static else {"rate": 50.0, "delay": 0.001, "delay_max": 0.004, "period": 0.02}
    figures = {
        **dict.fromkeys(("rate", "delay", "delay_max", "delay_min", "jitter", "period")),
        "publisher_id": 0,
        "count": 9,
        "gap": 0.02,
        "first": 3.0,
        "silence": 0.01,
        "stalled": 0.01,
        **timed,
        **figures,
    }
    return Stream(frame=frame, parent=parent, publisher=publisher, static=static, **figures)


ROBOT = [stream("odom"), stream("base", "odom", publisher="/wheels"), stream("camera", "base", static=True)]


def groups(svg, kind):
    """The texts of the parts of one class, each as a list of lines."""
    return [
        [text.text for text in group.iter(f"{SVG}text") if text.text.strip()]
        for group in ElementTree.fromstring(svg).iter(f"{SVG}g")
        if kind in group.get("class", "").split()
    ]


def drawn(*arguments, **how):
    return render(tree_dot(*arguments, **how), "svg")


@needs_dot
class TestTree:
    def test_has_a_node_for_each_frame_and_an_edge_for_each_stream(self):
        svg = drawn(ROBOT, lengths={"odom": 9.5}, time=12.5)
        assert sorted(groups(svg, "frame")) == [["base"], ["camera"], ["map"], ["odom"]]
        assert groups(svg, "static") == [["/robot", "static"]]
        figures = ["50.0 Hz", "delay 1.0 ms, max 4.0 ms"]
        assert sorted(groups(svg, "dynamic")) == [
            ["/robot", *figures, "buffer 9.50 s"],
            ["/wheels", *figures],
        ]
        assert [["Recorded at time: 12.500"]] == [lines[:1] for lines in groups(svg, "cluster")]
        assert sorted(groups(svg, "legend")) == [["dynamic"], ["stale"], ["static"]]

    def test_stale_frames_differ_in_colour_and_style(self):
        late = stream("arm", silence=4.2)
        dot = tree_dot([*ROBOT, late], [Finding("stale", "arm", "arm was last received 4.2 s ago")])
        [edge] = groups(render(dot, "svg"), "stale")
        assert edge[-1] == "stale for 4.2 s"
        strokes = re.findall(r'class="?(stale|static|dynamic)"? color="(.*?)".*?style=(\w+)', dot)
        assert len({colour for _, colour, _ in strokes}) == 3
        assert len({style for *_, style in strokes}) == 3

    def test_two_publishers_are_two_edges(self):
        svg = drawn([stream("base"), stream("base", publisher="/intruder")])
        assert sorted(lines[0] for lines in groups(svg, "dynamic")) == ["/intruder", "/robot"]
        assert len(groups(svg, "frame")) == 2

    def test_tells_what_is_wrong(self):
        findings = [Finding("gap", "odom", f"gap {number}") for number in range(MOST_FINDINGS + 3)]
        root = ElementTree.fromstring(drawn(ROBOT, findings))
        texts = [text.text for text in root.iter(f"{SVG}text")]
        assert {"gap 0", f"gap {MOST_FINDINGS - 1}", "and 3 more"} <= set(texts)
        assert f"gap {MOST_FINDINGS}" not in texts

    @pytest.mark.parametrize("name", HOSTILE)
    def test_shows_a_name_as_it_is(self, name):
        svg = drawn([stream(name, publisher=name)])
        assert sorted(groups(svg, "frame")) == sorted([["map"], [name]])
        assert [lines[0] for lines in groups(svg, "dynamic")] == [name]

    @pytest.mark.parametrize(
        ("name", "shown"), [("\x1b[31m\n", r"\x1b[31m\n"), ("\ud800", r"\ud800"), ("\x00", r"\x00")]
    )
    def test_escapes_what_does_not_print(self, name, shown):
        assert [shown] in groups(drawn([stream(name)]), "frame")

    def test_of_nothing_says_so(self):
        texts = [text.text for text in ElementTree.fromstring(drawn([])).iter(f"{SVG}text")]
        assert "no transform was received" in texts

    @pytest.mark.parametrize("kind", STARTS)
    def test_every_format_is_what_its_name_says(self, kind):
        assert render(tree_dot(ROBOT), kind).startswith(STARTS[kind])

    def test_the_same_streams_give_the_same_text(self):
        assert tree_dot(ROBOT) == tree_dot(ROBOT)

    def test_without_dot_that_is_the_error(self, monkeypatch, tmp_path):
        monkeypatch.setenv("PATH", str(tmp_path))
        with pytest.raises(FileNotFoundError):
            render(tree_dot(ROBOT), "svg")

    def test_what_dot_says_is_in_the_error(self):
        with pytest.raises(RuntimeError, match="syntax error"):
            render("digraph {", "svg")

    def test_graphviz_reads_what_is_written(self):
        dot = tree_dot([stream(name, publisher=name) for name in HOSTILE])
        subprocess.run(["dot", "-Tcanon"], input=dot.encode(), check=True, capture_output=True)


class TestLabels:
    def test_a_long_name_loses_its_middle(self):
        assert label("a" * 500 + "z" * 500, 10) == "aaaaa…zzzzz"
        assert label("a" * 10, 10) == "a" * 10

    def test_what_escapes_make_long_is_cut_too(self):
        assert len(label("\x1b" * 60, 60)) == 61


BEGIN, END = 1000.0, 1010.0
NOTHING = np.zeros(0)


def row(name, times, delay=0.001, gap=0.2, **how):
    times = np.asarray(times, float)
    return Heard(name, stream(name, **how), times, np.full(len(times), delay), gap)


def texts_of(figure):
    root = ElementTree.fromstring(file_of(figure, "svg"))
    return ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]


def bars(figure):
    """The gaps that a figure shows: row from below, begin and length."""
    found = []
    for collection in figure.axes[0].collections:
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
        for text in ("received", "static: received, and holds", "gap"):
            assert text in texts
        assert "seconds since 1010.000" in texts

    def test_gaps_are_where_nothing_was_received_for_too_long(self):
        with_gap = STEADY[(STEADY < BEGIN + 4) | (STEADY >= BEGIN + 6)]
        rows = [row("steady", STEADY), row("with_gap", with_gap), row("stopped", STEADY[STEADY < BEGIN + 7])]
        rows.append(row("silent", [BEGIN - 1]))
        rows.append(row("slow", [BEGIN, BEGIN + 5], gap=inf))
        assert bars(heard_figure(rows, BEGIN, END)) == [
            (1.0, -10.0, 10.0),
            (2.0, -3.01, 3.01),
            (3.0, -6.01, 2.02),
        ]

    def test_every_transform_is_a_line(self):
        figure = heard_figure([row("odom", STEADY[::50])], BEGIN, END)
        lines = figure.axes[0].collections[0].get_segments()
        assert [segment[0][0] for segment in lines] == pytest.approx(STEADY[::50] - END, abs=0.002)

    def test_a_frame_that_was_not_received_says_so(self):
        texts = texts_of(heard_figure([Heard("arm", None, NOTHING, NOTHING, inf)], BEGIN, END))
        assert {"arm", "not received"} <= set(texts)

    @pytest.mark.parametrize("name", [*HOSTILE, "$\\frac{$"])
    def test_a_name_is_shown_as_it_is(self, name):
        assert name in texts_of(heard_figure([row(name, STEADY)], BEGIN, END))

    def test_stamps_in_the_future_stay_in_their_row(self):
        figure = heard_figure([row("ahead", STEADY, delay=-5.0)], BEGIN, END)
        [dots] = [line for line in figure.axes[0].lines if line.get_marker() == "."]
        assert 0.0 < dots.get_ydata().min() <= dots.get_ydata().max() < 1.0

    def test_too_many_rows_are_cut_and_told(self):
        rows = [row(f"frame{number}", [BEGIN + 1]) for number in range(MOST_ROWS + 3)]
        figure = heard_figure(rows, BEGIN, END)
        assert figure.axes[0].get_xlabel() == "seconds since 1010.000 (3 more are not shown)"
        assert len(figure.axes[0].get_yticks()) == MOST_ROWS

    def test_the_margins_do_not_depend_on_the_rows(self):
        few, many = [row("odom", STEADY)] * 2, [row("odom", [BEGIN - 1], static=True)] * 20
        for rows in (few, many):
            figure = heard_figure(rows, BEGIN, END)
            file_of(figure, "png")
            assert figure.axes[0].get_position().y0 * figure.get_figheight() < 0.6

    def test_rows_are_made_of_records(self):
        frames = ["map", "odom", "base"]
        ns = int(BEGIN) * 10**9
        records = np.array(
            [
                (ns + 20, ns + 10, 1, 0, 0, 0, 0),
                (ns + 30, ns + 10, 2, 1, 0, 1, 0),
                (ns + 40, ns + 10, 1, 0, 1, 0, 0),
                (ns + 10**9, ns, 1, 0, 0, 0, 0),
            ],
            RECORD,
        )
        streams = [stream("odom", publisher_id=0), stream("odom", publisher_id=1, period=0.1)]
        streams.append(stream("base", "odom", static=True))
        rows = heard_rows(records, streams, frames, Limits())
        assert [one.name for one in rows] == ["odom", "odom", "base"]
        assert [list(one.times) for one in rows] == [
            [BEGIN + 20e-9, BEGIN + 1],
            [BEGIN + 40e-9],
            [BEGIN + 30e-9],
        ]
        assert list(rows[0].delays) == pytest.approx([10e-9, 1.0])
        assert [one.gap for one in rows] == [pytest.approx(0.2), pytest.approx(0.5), inf]


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
                assert line.get_xdata() == pytest.approx(self.TIMES - 100.0)
                assert line.get_ydata() == pytest.approx(values[:, column])
        assert [line.get_label() for line in upper.lines] == ["x", "y", "z"]
        assert [line.get_label() for line in lower.lines] == ["roll", "pitch", "yaw"]
        assert len({line.get_linestyle() for line in upper.lines}) == 3
        assert lower.get_xlabel() == "seconds since 100.000"

    def test_what_is_unknown_is_a_gap(self):
        positions, rpy = self.POSITIONS.copy(), self.RPY.copy()
        positions[50:60], rpy[50:60] = np.nan, np.nan
        _, _, lower = self.figure(positions=positions, rpy=rpy).axes
        yaw = lower.lines[2].get_ydata()
        assert np.isnan(yaw[50:60]).all() and not np.isnan(np.delete(yaw, np.s_[50:60])).any()
        # And no whole turn is lost in it.
        assert yaw[-1] == pytest.approx(np.unwrap(self.RPY[:, 2])[-1])

    def test_what_stands_still_is_a_point_and_no_noise(self):
        generator = np.random.default_rng(1)
        still = 5.0 + 1e-9 * generator.normal(size=self.POSITIONS.shape)
        above = self.figure(positions=still).axes[0]
        assert np.ptp(above.get_xlim()) > 1e-4

    def test_one_time_is_enough(self):
        one = {"times": self.TIMES[:1], "positions": self.POSITIONS[:1], "rpy": self.RPY[:1]}
        assert file_of(self.figure(**one), "png").startswith(STARTS["png"])

    def test_hostile_names_are_shown_as_they_are(self):
        figure = trajectory_figure("$x$", "<b>&\x1b", self.TIMES, self.POSITIONS, self.RPY)
        assert r"<b>&\x1b in $x$" in texts_of(figure)

    def test_the_png_is_a_picture_and_not_empty(self):
        from io import BytesIO

        from matplotlib.image import imread

        pixels = imread(BytesIO(file_of(self.figure(), "png")))
        assert pixels.shape[:2] == (550, 1100)
        colours = np.unique((255 * pixels[..., :3]).round().astype(int).reshape(-1, 3), axis=0).tolist()
        assert [0, 114, 178] in colours and [230, 159, 0] in colours and [0, 158, 115] in colours


def test_drawing_leaves_matplotlib_as_it_was():
    import matplotlib

    before = dict(matplotlib.rcParams)
    file_of(heard_figure([row("odom", STEADY)], BEGIN, END), "svg")
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize(
    ("refusals", "said"),
    [
        ([8, 8], "all transforms of base are refused"),
        # Received before the clock jumped back, after which there is no stream of it.
        ([8, 0], "no transform of base was received"),
        ([], "no transform of base was received"),
    ],
)
def test_of_a_frame_that_cannot_be_drawn_it_is_said_why(refusals, said):
    records = np.zeros(len(refusals), RECORD)
    records["child"], records["refusals"] = 1, refusals
    with pytest.raises(RunError, match=f"^{said}$"):
        heard_picture(records, [], ["map", "base"], ["base"], (0.0, 1.0))
