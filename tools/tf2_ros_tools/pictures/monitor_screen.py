# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The full-screen table of tf2_monitor: sorted, filtered and scrolled by keys, below the problems."""

import asyncio
import ctypes
import os
import signal
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from tempfile import TemporaryFile

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.widgets import DataTable, Footer, Input, Static

from tf2_py.printable import printable
from tf2_ros_tools.common.output import counted
from tf2_ros_tools.common.program import RunError
from tf2_ros_tools.diagnosis.stream_statistics import Stream
from tf2_ros_tools.diagnosis.texts import milliseconds, rate_text
from tf2_ros_tools.listening.session import Report

Kinds = defaultdict[str, list[str]]  # of findings, by frame

INTERVAL_S = 1.0  # between two updates
PR_SET_PDEATHSIG = 1  # of Linux: a signal for when the parent process dies

COLUMNS = ("frame", "Hz", "delay ms", "wrong", "parent", "publisher", "max ms", "jitter ms")
NUMBERS = {"Hz", "delay ms", "max ms", "jitter ms"}


def _texts(stream: Stream, kinds: Sequence[str]) -> Iterator[str]:
    """What the columns show of a stream; ``kinds`` are those of its frame's findings."""
    rate = "static" if stream.static else rate_text(stream)
    delay, most, jitter = map(milliseconds, (stream.delay, stream.delay_max, stream.jitter))
    wrong = ", ".join(dict.fromkeys(kinds))
    return map(printable, (stream.frame, rate, delay, wrong, stream.parent, stream.publisher, most, jitter))


# The smallest value is shown first; unknown rates and delays come last.
ORDERS: dict[str, Callable[[Stream, int], tuple[float, str]]] = {
    "trouble": lambda stream, problem_count: (-problem_count, stream.frame),
    "name": lambda stream, _: (0, stream.frame),
    "rate": lambda stream, _: (-(stream.rate or 0.0) if not stream.static else 1.0, stream.frame),
    "delay": lambda stream, _: (float("inf") if stream.delay is None else -stream.delay, stream.frame),
}


def show_screen(look: Callable[[], Report], source: str) -> int:
    """
    Show reports until the user or a signal ends it, in the main thread; return the exit status.

    Textual prints the traceback of an error in here, and the status is not 0; not of a RunError.

    :param look: makes a report of the present state.
    :param source: the topics and the ROS domain, as a phrase.
    :raises RunError: ``look`` raised it.
    """
    # Textual draws on sys.__stderr__, which may be a file, or for a browser on sys.__stdout__. What C code
    # writes, such as log lines, would disturb the screen, so it follows at the end.
    output, error_output = os.dup(1), os.dup(2)
    drawn = open(output, "w", encoding=sys.stdout.encoding, errors=sys.stdout.errors, closefd=False)
    sys.__stdout__ = sys.__stderr__ = drawn  # type: ignore[misc]
    with TemporaryFile() as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        try:
            screen = _Screen(look, source)
            screen.run(mouse=False)  # so that the terminal itself selects text
        finally:
            os.dup2(output, 1)
            os.dup2(error_output, 2)
            log.seek(0)
            os.write(2, log.read())
    if screen.failure is not None:
        raise screen.failure
    return screen.return_code or 0


class _Screen(App[None]):
    CSS = """
    #summary { height: auto; padding: 0 1; }
    VerticalScroll { height: auto; max-height: 30%; padding: 0 1; }
    VerticalScroll Static { height: auto; color: $text-error; }
    #filter { height: 1; border: none; padding: 0 1; }
    DataTable { height: 1fr; min-height: 3; }
    """
    BINDINGS = [
        Binding("t", "sort('trouble')", "Trouble", tooltip="The frames with the most problems first"),
        Binding("n", "sort('name')", "Name", tooltip="Sort by name"),
        Binding("r", "sort('rate')", "Rate", tooltip="Sort by rate, the highest first"),
        Binding("d", "sort('delay')", "Delay", tooltip="Sort by delay, the longest first"),
        # Of the screen as a whole: otherwise the keys that follow at once would miss the filter.
        Binding("slash", "filter", "Filter", key_display="/", priority=True),
        Binding("escape", "show_all", show=False),
        Binding("q", "quit", "Quit"),
        Binding("ctrl+c", "quit", show=False, priority=True),
    ]
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, look: Callable[[], Report], source: str) -> None:
        super().__init__()
        self._look = look
        self._report = look()
        self.failure: RunError | None = None  # why it has ended
        self._source = source
        self._streams: list[Stream] = []  # a row for each
        self._order = "trouble"

    def compose(self) -> ComposeResult:
        yield Static(id="summary", markup=False)
        with VerticalScroll():
            yield Static(id="problems", markup=False)
        yield Input(placeholder="/ filters by a part of a frame, parent or publisher", id="filter")
        yield DataTable(cursor_type="row", fixed_columns=1)
        yield Footer()

    def on_mount(self) -> None:
        if self.is_web:  # Textual would not notice that its server was killed
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self.exit)
        table = self.query_one(DataTable)
        for column in COLUMNS:
            table.add_column(_cell(column, column))
        table.focus()
        self._show()
        self._updates = self.set_interval(INTERVAL_S, self._update)

    def _update(self) -> None:
        try:
            self._report = self._look()
        except RunError as failure:
            if self.is_web:  # where nobody would see what the program prints
                self._updates.stop()
                self.query_one("#summary", Static).update(Text(printable(str(failure)), "bold red"))
            else:
                self.failure = failure
                self.exit()
            return
        self._show()

    def on_exit_app(self) -> None:
        # If a tab is closed before its first screen is drawn, Textual would draw for ever instead of ending.
        if self.is_web:
            raise KeyboardInterrupt

    # Keys.

    def action_sort(self, order: str) -> None:
        self._order = order
        self._show()

    def action_filter(self) -> None:
        self.screen.set_focus(self.query_one(Input))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool:
        # In the filter, a slash is a letter.
        return action != "filter" or self.focused is not self.query_one(Input)

    def on_input_submitted(self) -> None:
        self.query_one(DataTable).focus()

    def action_show_all(self) -> None:
        self.query_one(Input).value = ""
        self.query_one(DataTable).focus()

    def on_input_changed(self) -> None:
        self._show()

    # What is shown.

    def _show(self) -> None:
        report = self._report
        kinds: Kinds = defaultdict(list)
        for finding in report.findings:
            kinds[finding.frame].append(finding.kind)
        with self.batch_update():
            self.query_one("#summary", Static).update(Text(self._summary(report)))
            self._fill(self._chosen(report.streams, kinds), kinds)
            problems = Text("\n".join(printable(one.text) for one in report.findings))
            self.query_one("#problems", Static).update(problems)
            self.query_one(VerticalScroll).display = bool(problems)

    def _summary(self, report: Report) -> str:
        frames = counted(len({stream.frame for stream in report.streams}), "frame")
        found = counted(len(report.findings), "problem")
        text = printable(f"{frames}, {found} {self._source}, by {self._order}")
        return text if report.chain is None else f"{printable(report.chain.text)}\n{text}"

    def _chosen(self, streams: Sequence[Stream], kinds: Kinds) -> list[Stream]:
        """Filter and sort streams."""
        part, key = self.query_one(Input).value.lower(), ORDERS[self._order]
        found = [one for one in streams if part in f"{one.frame} {one.parent} {one.publisher}".lower()]
        found.sort(key=_name_of)  # in a report, the order of those of one frame varies
        found.sort(key=lambda one: key(one, len(kinds[one.frame])))
        return found

    def _fill(self, streams: list[Stream], kinds: Kinds) -> None:
        table = self.query_one(DataTable)
        # None: the first row, which stays highlighted.
        chosen = _name_of(self._streams[table.cursor_row]) if table.cursor_row > 0 else None
        x, y = table.scroll_offset
        table.clear()
        # Back at once: after the next refresh, it would undo what a key scrolls meanwhile.
        table.scroll_to(x, y, animate=False, force=True, immediate=True)
        self._streams = streams
        for stream in streams:
            style = "bold red" if kinds[stream.frame] else ""
            texts = zip(_texts(stream, kinds[stream.frame]), COLUMNS, strict=True)
            table.add_row(*(_cell(text, column, style) for text, column in texts))
        place = next((row for row, one in enumerate(streams) if _name_of(one) == chosen), 0)
        table.move_cursor(row=place, scroll=False)


def _cell(text: str, column: str, style: str = "") -> Text:
    # Not a str, because a name may look like markup.
    return Text(text, style=style, justify="right" if column in NUMBERS else "left", overflow="fold")


def _name_of(stream: Stream) -> tuple[str, str, int, bool]:
    return stream.frame, stream.parent, stream.publisher_id, stream.static
