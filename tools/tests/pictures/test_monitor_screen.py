# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The table of tf2_monitor on terminals of several sizes, and its keys."""

import asyncio
import math
import os
import re
import signal
import subprocess
import sys
import termios
import time
from dataclasses import replace
from itertools import takewhile

import pytest
from times_and_transforms import S
from waiting import DEADLINE_S, until

pytest.importorskip("pexpect")
pytest.importorskip("pyte")
pytest.importorskip("textual")

import pexpect
from picture_samples import stream
from processes import killed
from terminals import Terminal
from textual.containers import VerticalScroll
from textual.widgets import DataTable

from tf2_py import FrameInfo
from tf2_ros_tools.diagnosis.findings import Finding
from tf2_ros_tools.diagnosis.stream_statistics import Stream
from tf2_ros_tools.listening.session import Chain, Report
from tf2_ros_tools.pictures.monitor_screen import _Screen

NAMES = [f"front_left_wheel_{number:02}" for number in range(20)]
TOPICS = ("-r", "/tf:=/tf_screen", "-r", "/tf_static:=/tf_static_screen")
DOWN, ESCAPE, CTRL_C = "\x1b[B", "\x1b", "\x03"

# A program whose reception ends after its first report.
ENDING = """
import sys
from tf2_ros_tools.listening.session import Report
from tf2_ros_tools.pictures.monitor_screen import show_screen
from tf2_ros_tools.common.program import Parser, RunError, run

reports = iter([Report(0.0, [], [], [], None, 0)])

def look():
    for report in reports:
        return report
    raise RunError("the robot has gone")

parser = Parser("tf2_monitor", "", "")
sys.exit(run(parser, lambda _: show_screen(look, dict, ""), ["tf2_monitor"], interrupted=0))
"""


def monitor(size, *arguments):
    return Terminal(*size, "tf2_monitor", *arguments, "--ros-args", *TOPICS)


@pytest.fixture
def talker(peer):
    """Sends static transforms of many frames, which wait for the monitor."""
    talker = peer(*TOPICS)
    talker.send_without_subscriber(*(("base_link", name, S, 1.0) for name in NAMES), static=True)
    return talker


def joined(lines):
    """The text of the screen, with folded lines put together."""
    return " ".join(" ".join(lines).split())


def names(lines):
    """The names of the frames that are shown, in their order; none if there is not one line of titles."""
    titles = [number for number, line in enumerate(lines) if re.match(r" frame +Hz\b", line)]
    below = lines[titles[0] + 1 :] if len(titles) == 1 else []
    return [row.split()[0] for row in takewhile(re.compile(r" \w+ +(static|[\d.]+|\?)( |$)").match, below)]


@pytest.mark.parametrize("size", [(120, 30), (45, 24)], ids=str)
def test_names_are_whole_and_all_frames_are_within_reach(size, talker):
    with monitor(size) as terminal:
        for name in NAMES:
            terminal.shows(lambda lines, name=name: name in names(lines))
            terminal.press(DOWN)


def test_the_chosen_row_stays_in_view_when_an_update_comes_beside_a_key():
    """At whichever step of one the other comes."""
    stream = Stream("", "base_link", "/peer", 0, True, 1, *10 * [None])
    report = Report(0.0, [replace(stream, frame=name) for name in NAMES], [], [], None, 0)

    async def play():
        screen = _Screen(lambda: report, dict, "")
        async with screen.run_test(size=(45, 24)) as pilot:
            table = screen.query_one(DataTable)
            last = table.scrollable_content_region.height - 2  # below the titles
            for turns in range(12):
                for row in (0, last):
                    table.move_cursor(row=row)
                    await pilot.pause()
                screen._update()
                for _ in range(turns):
                    await asyncio.sleep(0)
                screen.simulate_key("down")
                await pilot.pause()
                await pilot.pause()
                yield turns, table.cursor_row - last, table.scroll_offset.y

    async def shown():
        return [one async for one in play()]

    assert asyncio.run(shown()) == [(turns, 1, 1) for turns in range(12)]


def test_an_update_while_the_widgets_are_removed_is_ignored():
    report = Report(0.0, [], [], [], None, 0)

    async def play():
        screen = _Screen(lambda: report, dict, "")
        async with screen.run_test():
            pass
        screen._update()

    asyncio.run(play())


def played(*streams, ages=(), findings=(), chain=None, keys=()):
    """After these keys: the texts and styles of the rows, the summary, how far the problems are scrolled."""
    report = Report(100.0, [*streams], [], [*findings], chain, 0)
    infos = {name: FrameInfo(None, False, 1, 0, round((100.0 - age) * S)) for name, age in dict(ages).items()}

    async def play():
        screen = _Screen(lambda: report, lambda: infos, "here")
        async with screen.run_test(size=(80, 24)) as pilot:
            await pilot.press(*keys)
            table, problems = screen.query_one(DataTable), screen.query_one(VerticalScroll)
            rows = [table.get_row_at(row) for row in range(table.row_count)]
            return (
                [[cell.plain for cell in row] for row in rows],
                [str(row[0].style) for row in rows],
                screen._summary(report),
                (problems.scroll_target_y, problems.max_scroll_y),
            )

    return asyncio.run(play())


class TestTree:
    """As rows: depth, frame, age."""

    @staticmethod
    def shown(*streams, keys=("e",), **report):
        """The rows after these keys."""
        rows, styles, summary, _ = played(*streams, keys=keys, **report)
        assert summary.endswith(" here, as a tree")
        lines = [(len(row[0]) - len(row[0].lstrip()), row[0].strip(), row[1]) for row in rows]
        return [(spaces // 2, name, age) for spaces, name, age in lines], styles

    def test_frames_are_below_their_parents_with_ages(self):
        rows, _ = self.shown(
            stream("odom"),
            stream("base_link", "odom"),
            stream("arm", "base_link"),
            stream("lidar", "odom", static=True),
            stream("beacon"),
            ages={"odom": 0.25, "base_link": 12.5, "lidar": 7.0},
        )
        assert rows == [
            (0, "map", ""),
            (1, "beacon", ""),
            (1, "odom", "0.25"),
            (2, "base_link", "12.50"),
            (3, "arm", ""),
            (2, "lidar", ""),
        ]

    def test_all_trees_and_loops_are_shown(self):
        rows, _ = self.shown(
            stream("a", "c"),
            stream("b", "a"),
            stream("c", "b"),
            stream("d", "b"),
            stream("fish", "sea"),
            stream("odom"),
        )
        assert [row[:2] for row in rows] == [
            *((0, "map"), (1, "odom"), (0, "sea"), (1, "fish")),
            *((0, "a"), (1, "b"), (2, "c"), (3, "a"), (2, "d")),
        ]

    def test_a_frame_is_below_each_of_its_parents_and_what_is_below_it_once(self):
        rows, _ = self.shown(stream("odom"), stream("arm"), stream("arm", "odom"), stream("hand", "arm"))
        assert [row[:2] for row in rows] == [(0, "map"), (1, "arm"), (2, "hand"), (1, "odom"), (2, "arm")]

    def test_frames_with_problems_are_red(self):
        findings = [Finding("stale", "odom", "…"), Finding("loop", "a", "…", ("a", "b"))]
        rows, styles = self.shown(
            stream("odom"), stream("base", "odom"), stream("a", "b"), stream("b", "a"), findings=findings
        )
        red = [name for (_, name, _), style in zip(rows, styles, strict=True) if "red" in style]
        assert red == ["odom", "a", "b", "a"]

    def test_a_filter_keeps_what_is_above_a_frame(self):
        streams = [stream("odom"), stream("base", "odom"), stream("hand", "base"), stream("tail", "base")]
        rows, _ = self.shown(*streams, stream("x"), stream("y", "x"), keys=("e", *"/HAND"))
        assert [row[:2] for row in rows] == [(0, "map"), (1, "odom"), (2, "base"), (3, "hand")]

    def test_a_chain_of_a_thousand_frames_is_shown(self):
        rows, _ = self.shown(*(stream(f"{one + 1:04}", f"{one:04}") for one in range(1200)))
        assert rows[-1][:2] == (1200, "1200")

    def test_it_is_shown_on_a_terminal_and_the_chosen_frame_stays_chosen(self, peer):
        talker = peer(*TOPICS)
        talker.send_without_subscriber(*(("map", name, S, 1.0) for name in NAMES), static=True)
        with monitor((80, 24)) as terminal:
            terminal.shows(lambda lines: len(names(lines)) >= 10)
            terminal.press(19 * DOWN)
            terminal.shows(lambda lines: NAMES[-1] in names(lines))
            terminal.press("e")
            terminal.shows(lambda lines: any(re.match(rf"   {NAMES[-1]} +static ", line) for line in lines))


class TestKeys:
    @pytest.mark.parametrize(
        ("key", "order", "what"), [("n", "abc", "name"), ("d", "bac", "delay"), ("r", "acb", "rate")]
    )
    def test_sorting_by_name_delay_and_rate(self, key, order, what):
        streams = stream("c", rate=20.0, delay=0.0), stream("b", rate=10.0, delay=5.0), stream("a", delay=1.0)
        rows, _, summary, _ = played(*streams, keys=key)
        assert "".join(row[0] for row in rows) == order
        assert summary == f"4 frames, 0 problems here, by {what}"

    def test_frames_with_problems_are_first(self):
        twice = Finding("publishers", "c", "…")
        for keys, order in (("", "cab"), ("n", "abc"), ("nt", "cab")):
            rows, styles, *_ = played(*map(stream, "abc"), findings=[twice], keys=keys)
            assert "".join(row[0] for row in rows) == order
            assert [row[3] for row in rows] == ["publishers" if one == "c" else "" for one in order]
            assert ["red" in style for style in styles] == [one == "c" for one in order]

    def test_a_filter_is_set_and_removed(self, talker):
        with monitor((80, 24)) as terminal:
            terminal.shows(lambda lines: len(names(lines)) >= 8)
            terminal.press("/WHEEL_1")  # all at once
            terminal.shows(lambda lines: names(lines) == NAMES[10:])
            terminal.press(ESCAPE)
            terminal.shows(lambda lines: NAMES[8] in names(lines))

    def test_in_the_filter_a_slash_is_a_letter(self):
        assert [row[0] for row in played(stream("ab"), stream("a/b"), keys="/a/b")[0]] == ["a/b"]

    @pytest.mark.parametrize("how", ["q", CTRL_C, "/" + CTRL_C, signal.SIGINT, signal.SIGTERM])
    def test_it_ends_and_the_terminal_is_as_before(self, how, talker):
        with monitor((80, 24)) as terminal:
            before = termios.tcgetattr(terminal.process.child_fd)
            terminal.shows(names)
            assert termios.tcgetattr(terminal.process.child_fd) != before
            terminal.press(how) if isinstance(how, str) else terminal.process.kill(how)
            assert terminal.ended() == 0
            assert "Traceback" not in terminal.process.before
            assert termios.tcgetattr(terminal.process.child_fd) == before

    def test_an_error_in_it_fails(self):
        program = (
            "import sys; from tf2_ros_tools.pictures.monitor_screen import show_screen; "
            "sys.exit(show_screen(lambda: 1 / 0, dict, ''))"
        )
        environment = {**os.environ, "TERM": "xterm-256color"}
        failing = pexpect.spawn(sys.executable, ["-c", program], env=environment, timeout=DEADLINE_S)
        failing.expect("ZeroDivisionError")
        failing.expect(pexpect.EOF)
        failing.wait()
        assert failing.exitstatus == 1

    def test_the_end_of_the_reception_ends_it_with_the_reason(self):
        environment = {**os.environ, "TERM": "xterm-256color"}
        ending = pexpect.spawn(sys.executable, ["-c", ENDING], env=environment, timeout=DEADLINE_S)
        ending.expect("tf2_monitor: the robot has gone")
        ending.expect(pexpect.EOF)
        ending.wait()
        assert ending.exitstatus == 1 and b"Traceback" not in ending.before

    def test_in_a_browser_the_end_of_the_reception_is_shown(self):
        environment = {
            **os.environ,
            "TEXTUAL_DRIVER": "textual.drivers.web_driver:WebDriver",
            "COLUMNS": "80",
            "ROWS": "24",
        }
        quits = b'{"type": "quit"}'
        pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        with killed(subprocess.Popen([sys.executable, "-c", ENDING], env=environment, **pipes)) as process:
            assert process.stdout.readline() == b"__GANGLION__\n"
            written = bytearray()
            until(lambda: b"the robot has gone" in written or written.extend(process.stdout.read1()))
            _, err = process.communicate(b"M" + len(quits).to_bytes(4, "big") + quits, DEADLINE_S)
        assert (process.returncode, err) == (0, b"")


class TestPanes:
    def test_problems_without_a_row_are_scrolled(self):
        many = [Finding("refused", f"broken_{number}", "…") for number in range(30)]
        assert played(stream("a"), findings=many)[3][0] == 0
        over_the_filter = ["shift+tab", "shift+tab", "end"]
        scrolled, most = played(stream("a"), findings=many, keys=over_the_filter)[3]
        assert scrolled == most > 20

    @pytest.mark.parametrize("to_stdout", [{}, {"RCUTILS_LOGGING_USE_STDOUT": "1"}], ids=str)
    def test_log_lines_are_written_at_the_end(self, to_stdout, talker):
        with Terminal(80, 24, "tf2_monitor", "--ros-args", *TOPICS, **to_stdout) as terminal:

            def is_refused(lines):
                assert "TF_NAN_INPUT" not in joined(lines)
                talker.send(("base_link", "broken", time.time_ns(), math.nan))
                return re.search(r"\d\d transforms of broken by \S+ are refused", joined(lines))

            terminal.shows(names)  # from here on, log lines are kept
            terminal.shows(is_refused)
            terminal.press("q")
            assert terminal.ended() == 0 and "TF_NAN_INPUT" in terminal.process.before

    def test_figures_beside_a_long_name_are_within_reach(self, peer):
        peer(*TOPICS).send_without_subscriber(
            ("map", "n" * 100, S, 1.0), ("map", "zebra", S, 1.0), static=True
        )
        with monitor((80, 24)) as terminal:
            terminal.shows(lambda lines: any("nnnn" in line for line in lines))
            terminal.press("\x1b[F")
            terminal.shows(lambda lines: any("jitter ms" in line for line in lines))
            terminal.press("\x1b[H")  # seen before the next key, because the filter's key overtakes others
            terminal.shows(lambda lines: any("nnnn" in line for line in lines))
            terminal.press("/zeb")  # without the long name, the column is narrow again
            terminal.shows(lambda lines: names(lines) == ["zebra"])

    def test_a_chain_and_names_are_not_markup(self):
        chain = Chain(("a", "b"), ["a", "b"], None, "[bold]a[/bold] -> b: no net delay")
        rows, _, summary, _ = played(stream("[red]arm", "[bold]map[/bold]"), chain=chain)
        assert summary.splitlines()[0] == chain.text
        assert (rows[0][0], rows[0][4]) == ("[red]arm", "[bold]map[/bold]")
