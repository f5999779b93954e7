# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The full screen of tf2_monitor: the problems above a table or tree, which keys sort, filter and scroll."""

import asyncio
import ctypes
import os
import signal
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from tempfile import TemporaryFile
from typing import NamedTuple

from rich.cells import cell_len
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.widgets import DataTable, Footer, Input, Static

from tf2_py import FrameInfo
from tf2_py.printable import counted, printable
from tf2_ros_tools.common.program import RunError
from tf2_ros_tools.diagnosis.stream_statistics import Stream
from tf2_ros_tools.diagnosis.texts import frame_count, milliseconds, rate_text
from tf2_ros_tools.listening.session import Report

Kinds = defaultdict[str, list[str]]  # of findings, by frame

INTERVAL_S = 1.0  # between two updates
PR_SET_PDEATHSIG = 1  # of Linux: a signal for when the parent process dies

S = 1_000_000_000

COLUMNS = ("frame", "Hz", "delay ms", "wrong", "parent", "publisher", "max ms", "jitter ms")
TREE_COLUMNS = ("frame", "age s", "Hz", "delay ms", "wrong", "publisher", "max ms", "jitter ms")
NUMBERS = {"age s", "Hz", "delay ms", "max ms", "jitter ms"}


class _Row(NamedTuple):
    """A row of a stream; in a tree also of a root, which has none."""

    frame: str
    depth: int  # below the root
    stream: Stream | None


def _key_of(row: _Row) -> tuple[str, str, int, bool]:
    """What tells a row apart from others, also those of later reports."""
    stream = row.stream
    if stream is None:
        return row.frame, "", 0, False
    return row.frame, stream.parent, stream.publisher_id, stream.static


def _texts(row: _Row, kinds: Sequence[str], info: FrameInfo | None, now_s: float) -> dict[str, str]:
    """What the columns show; ``kinds`` are those of the frame's findings. Root frames have no figures."""
    texts = {"frame": "  " * row.depth + row.frame, "wrong": ", ".join(dict.fromkeys(kinds))}
    if (stream := row.stream) is not None:
        texts |= {"parent": stream.parent, "publisher": stream.publisher}
        texts["Hz"] = "static" if stream.static else rate_text(stream)
        figures = {"delay ms": stream.delay, "max ms": stream.delay_max, "jitter ms": stream.jitter}
        texts |= {column: milliseconds(one) for column, one in figures.items()}
        if not stream.static and info is not None and info.newest_ns is not None and now_s > 0.0:
            texts["age s"] = f"{now_s - info.newest_ns / S:.2f}"
    return texts


def _tree(streams: Iterable[Stream]) -> Iterator[_Row]:
    """Get the rows of all trees, from each root down, with the children of a frame once."""
    children: dict[str, list[_Row]] = defaultdict(list)
    for one in streams:
        children[one.parent].append(_Row(one.frame, 0, one))
    frames = {one.frame for one in streams}
    # The frames of a loop have no root above them, so one of them is the first.
    for root in sorted(children, key=lambda name: (name in frames, name)):
        pending = [_Row(root, 0, None)] if root in children else []
        while pending:
            row = pending.pop()
            yield row
            below = sorted(children.pop(row.frame, ()), key=_key_of, reverse=True)
            pending += [one._replace(depth=row.depth + 1) for one in below]


# The smallest value is shown first; unknown rates and delays come last.
ORDERS: dict[str, Callable[[Stream, int], tuple[float, str]]] = {
    "trouble": lambda stream, problem_count: (-problem_count, stream.frame),
    "name": lambda stream, _: (0, stream.frame),
    "rate": lambda stream, _: (-(stream.rate or 0.0) if not stream.static else 1.0, stream.frame),
    "delay": lambda stream, _: (float("inf") if stream.delay is None else -stream.delay, stream.frame),
}


def show_screen(look: Callable[[], Report], infos: Callable[[], Mapping[str, FrameInfo]], source: str) -> int:
    """
    Show reports until the user or a signal ends it, in the main thread; return the exit status.

    Textual prints the traceback of an error in here, and the status is not 0; not of a RunError.

    :param look: makes a report of the present state.
    :param infos: gets the frames of the buffer, for their ages.
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
            screen = _Screen(look, infos, source)
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
        Binding(
            "e", "sort('tree')", "Tree", tooltip="The tree of frames, and the ages of their newest transforms"
        ),
        # Of the screen as a whole: otherwise the keys that follow at once would miss the filter.
        Binding("slash", "filter", "Filter", key_display="/", priority=True),
        Binding("escape", "show_all", show=False),
        Binding("q", "quit", "Quit"),
        Binding("ctrl+c", "quit", show=False, priority=True),
    ]
    ENABLE_COMMAND_PALETTE = False

    def __init__(
        self, look: Callable[[], Report], infos: Callable[[], Mapping[str, FrameInfo]], source: str
    ) -> None:
        super().__init__()
        self._look, self._look_at_frames = look, infos
        self._look_again()
        self.failure: RunError | None = None  # why it has ended
        self._source = source
        self._columns: tuple[str, ...] = ()
        self._rows: list[_Row] = []
        self._order = "trouble"

    def compose(self) -> ComposeResult:
        yield Static(id="summary", markup=False)
        with VerticalScroll():
            yield Static(id="problems", markup=False)
        yield Input(placeholder="/ filters by a part of a frame, parent or publisher", id="filter")
        yield DataTable(cursor_type="row")
        yield Footer()

    def on_mount(self) -> None:
        if self.is_web:  # Textual would not notice that its server was killed
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self.exit)
        self.query_one(DataTable).focus()
        self._show()
        self._updates = self.set_interval(INTERVAL_S, self._update)

    def _look_again(self) -> None:
        self._infos = self._look_at_frames()  # first, so that no age is negative
        self._report = self._look()

    def _update(self) -> None:
        if not self.is_running:  # Textual removes the widgets before it ends the timers
            return
        try:
            self._look_again()
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
            for frame in finding.frames or (finding.frame,):
                kinds[frame].append(finding.kind)
        with self.batch_update():
            self.query_one("#summary", Static).update(Text(self._summary(report)))
            self._fill(self._chosen(report.streams, kinds), kinds)
            problems = Text("\n".join(printable(one.text) for one in report.findings))
            self.query_one("#problems", Static).update(problems)
            self.query_one(VerticalScroll).display = bool(problems)

    def _summary(self, report: Report) -> str:
        frames, found = frame_count(report.streams), counted(len(report.findings), "problem")
        text = printable(
            f"{frames}, {found} {self._source}, {'as a' if self._order == 'tree' else 'by'} {self._order}"
        )
        return text if report.chain is None else f"{printable(report.chain.text)}\n{text}"

    def _chosen(self, streams: Sequence[Stream], kinds: Kinds) -> list[_Row]:
        """Filter and sort streams; in a tree, with the frames above those that are chosen."""
        part = self.query_one(Input).value.lower()
        if self._order == "tree":
            rows = []
            above = -1  # the depth of the next frame above
            for row in reversed([*_tree(streams)]):
                if row.depth == above or part in _searched(row):
                    rows.append(row)
                    above = row.depth - 1
            return rows[::-1]
        order = ORDERS[self._order]

        def rank(stream: Stream) -> tuple[object, ...]:
            # In a report, the order of those of one frame varies.
            return *order(stream, len(kinds[stream.frame])), stream.parent, stream.publisher_id, stream.static

        rows = [_Row(one.frame, 0, one) for one in sorted(streams, key=rank)]
        return [row for row in rows if part in _searched(row)]

    def _fill(self, rows: list[_Row], kinds: Kinds) -> None:
        table = self.query_one(DataTable)
        # None: the first row, which stays highlighted.
        chosen = _key_of(self._rows[table.cursor_row]) if table.cursor_row > 0 else None
        columns = TREE_COLUMNS if self._order == "tree" else COLUMNS
        is_other, self._columns = columns != self._columns, columns
        x, y = (0, 0) if is_other else table.scroll_offset
        table.clear(columns=True)  # which would stay as wide as names that are no longer there
        for column in columns:
            table.add_column(_cell(column, column))
        # Back at once: after the next refresh, it would undo what a key scrolls meanwhile.
        table.scroll_to(x, y, animate=False, force=True, immediate=True)
        self._rows = rows
        for row in rows:
            style = "bold red" if kinds[row.frame] else ""
            texts = _texts(row, kinds[row.frame], self._infos.get(row.frame), self._report.time)
            table.add_row(*(_cell(printable(texts.get(one, "")), one, style) for one in columns))
        # Beside long names or in a deep tree, the other columns would not be within reach.
        widest = max((cell_len(printable(row.frame)) + 2 * row.depth for row in rows), default=0)
        table.fixed_columns = 1 if 2 * widest <= table.size.width else 0
        place = next((number for number, row in enumerate(rows) if _key_of(row) == chosen), 0)
        table.move_cursor(row=place, scroll=is_other)


def _searched(row: _Row) -> str:
    parts = [row.frame] if row.stream is None else [row.frame, row.stream.parent, row.stream.publisher]
    return " ".join(parts).lower()


def _cell(text: str, column: str, style: str = "") -> Text:
    # Not a str, because a name may look like markup.
    return Text(text, style=style, justify="right" if column in NUMBERS else "left", overflow="fold")
