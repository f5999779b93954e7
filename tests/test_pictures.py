"""Pictures, drawn from records and arrays without a node, and read again."""

import re
import subprocess
from xml.etree import ElementTree

import pytest

from tf2_ros._pictures.labels import label
from tf2_ros._pictures.tree import MOST_FINDINGS, render, tree_dot
from tf2_ros._traffic.findings import Finding
from tf2_ros._traffic.streams import Stream

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
