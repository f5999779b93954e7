"""The full-screen table of tf2_monitor: sorted, filtered and scrolled by keys, with log lines below it."""

import asyncio
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from tempfile import TemporaryFile
from typing import IO

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.widgets import DataTable, Footer, Input, RichLog, Static

from tf2_ros_tools.findings import Finding, milliseconds, rate_text, stream_line
from tf2_ros_tools.listening import Report
from tf2_ros_tools.output import counted, printable
from tf2_ros_tools.streams import Stream

INTERVAL_S = 1.0  # between two updates ...
FRAMES_PER_S = 100  # ... of so many frames; with more of them, updates are less frequent ...
LONGEST_INTERVAL_S = 3.0  # ... but at least this frequent
LOG_LINES = 200  # that are kept


@dataclass(frozen=True)
class _Column:
    title: str
    text: Callable[[Stream, Sequence[str]], str]  # of a stream and the kinds of its frame's findings
    is_number: bool = False


def _of_delay(get: Callable[[Stream], float | None]) -> Callable[[Stream, Sequence[str]], str]:
    return lambda stream, _: "" if stream.static else milliseconds(get(stream))


COLUMNS = (
    _Column("frame", lambda stream, _: stream.frame),
    _Column("Hz", lambda stream, _: "static" if stream.static else rate_text(stream), is_number=True),
    _Column("delay ms", _of_delay(lambda stream: stream.delay), is_number=True),
    _Column("wrong", lambda _, kinds: _shortened(kinds)),
    _Column("parent", lambda stream, _: stream.parent),
    _Column("publisher", lambda stream, _: stream.publisher),
    _Column("max ms", _of_delay(lambda stream: stream.delay_max), is_number=True),
    _Column("jitter ms", _of_delay(lambda stream: stream.jitter), is_number=True),
)
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

    Textual prints the traceback of an error in here, and the status is not 0.

    :param look: makes a report of the present state.
    :param source: the topics and the ROS domain, as a phrase.
    """
    with _terminal_for_textual() as log_file:
        screen = _Screen(look, source, log_file)
        screen.run(mouse=False)  # so that the terminal itself selects text
        return screen.return_code or 0


@contextmanager
def _terminal_for_textual() -> Iterator[IO[bytes]]:
    """
    Let Textual draw on standard output, and keep log lines, which C code writes, from standard error.

    Textual draws on ``sys.__stderr__``, which may be a file. The result is a file into which standard error
    is written, if that is a terminal; what is left in it is written to standard error at the end.
    """
    error_output, draws_on = sys.__stderr__, os.fdopen(os.dup(1), "w", encoding="utf-8")
    sys.__stderr__ = draws_on  # type: ignore[misc]
    before = os.dup(2)
    with TemporaryFile("a+b") as log_file:
        if os.isatty(2):
            os.dup2(log_file.fileno(), 2)
        try:
            yield log_file
        finally:
            os.dup2(before, 2)
            os.close(before)
            os.write(2, _taken(log_file))  # such as a traceback by Textual
            sys.__stderr__ = error_output  # type: ignore[misc]
            draws_on.close()


def _taken(file: IO[bytes]) -> bytes:
    """Read a file that others append to, and empty it."""
    file.seek(0)
    content = file.read()
    file.truncate(0)
    return content


class _Screen(App[None]):
    CSS = """
    #summary { height: auto; padding: 0 1; }
    VerticalScroll { height: auto; max-height: 30%; padding: 0 1; }
    VerticalScroll Static { height: auto; }
    #wrong { color: $text-error; }
    #filter { height: 1; border: none; padding: 0 1; }
    DataTable { height: 1fr; min-height: 3; }
    RichLog { height: auto; max-height: 25%; padding: 0 1; border-top: solid $panel; display: none; }
    """
    BINDINGS = [
        Binding("t", "sort('trouble')", "Trouble", tooltip="The frames with the most problems first"),
        Binding("n", "sort('name')", "Name", tooltip="Sort by name"),
        Binding("r", "sort('rate')", "Rate", tooltip="Sort by rate, the highest first"),
        Binding("d", "sort('delay')", "Delay", tooltip="Sort by delay, the longest first"),
        # Of the screen as a whole: otherwise the keys that follow at once would miss the filter, or reach it.
        Binding("slash", "filter", "Filter", key_display="/", priority=True),
        Binding("enter", "leave_filter", show=False, priority=True),
        Binding("escape", "show_all", show=False),
        Binding("q", "quit", "Quit"),
        Binding("ctrl+c", "quit", show=False, priority=True),
        Binding("ctrl+z", "suspend_process", show=False, priority=True),
    ]
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, look: Callable[[], Report], source: str, log_file: IO[bytes]) -> None:
        super().__init__()
        self._look = look
        self._source = source
        self._log_file = log_file
        self._report: Report | None = None
        self._problems: dict[str, list[Finding]] = {}  # by frame
        self._streams: list[Stream] = []  # a row for each
        self._order, self._reverse = "trouble", False

    def compose(self) -> ComposeResult:
        yield Static(id="summary", markup=False)
        with VerticalScroll(id="wrong"):
            yield Static(markup=False)
        yield Input(placeholder="/ filters by a part of a frame, parent or publisher", id="filter")
        yield DataTable(cursor_type="row", fixed_columns=1)
        with VerticalScroll(id="details"):
            yield Static(markup=False)
        yield RichLog(max_lines=LOG_LINES, wrap=True, min_width=1)
        yield Footer()

    def on_mount(self) -> None:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self.exit)
        # After Ctrl-Z and `fg`, Textual itself would write only what has changed.
        self.app_resume_signal.subscribe(self, lambda _: self.screen.refresh())
        table = self.query_one(DataTable)
        for column in COLUMNS:
            table.add_column(_cell(column.title, column))
        table.focus()
        self._update()

    def _update(self) -> None:
        self._report = self._look()
        self._problems = {}
        for problem in self._report.findings:
            self._problems.setdefault(problem.frame, []).append(problem)
        self._show()
        self._show_log()
        interval_s = max(INTERVAL_S, len(self._streams) / FRAMES_PER_S)
        self.set_timer(min(interval_s, LONGEST_INTERVAL_S), self._update)

    # Keys.

    def action_sort(self, order: str) -> None:
        self._reverse = order == self._order and not self._reverse
        self._order = order
        self._show()

    def action_filter(self) -> None:
        self.screen.set_focus(self.query_one(Input))

    def action_leave_filter(self) -> None:
        self.screen.set_focus(self.query_one(DataTable))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool:
        # In the filter, a slash is a letter. Outside it, Enter is a key of the table.
        is_in_filter = self.focused is self.query_one(Input)
        return {"filter": not is_in_filter, "leave_filter": is_in_filter}.get(action, True)

    def action_show_all(self) -> None:
        self.query_one(Input).value = ""
        self.query_one(DataTable).focus()

    def on_input_changed(self) -> None:
        self._show()

    # What is shown.

    def _show(self) -> None:
        report = self._report
        if report is None:
            return
        streams = report.streams
        with self.batch_update():
            self.query_one("#summary", Static).update(Text(self._summary(report, streams)))
            self._fill(self._chosen(streams))
            # The problems of no frame, and of frames that have no row.
            elsewhere = self._problems.keys() - {stream.frame for stream in streams}
            found = [one for frame in sorted(elsewhere) for one in self._problems[frame]]
            self._show_pane("#wrong", Text("\n".join(printable(one.text) for one in found)))
            self._show_pane("#details", self._details())

    def _summary(self, report: Report, streams: Sequence[Stream]) -> str:
        frames = counted(len({stream.frame for stream in streams}), "frame")
        found = counted(sum(map(len, self._problems.values())), "problem")
        order = f"by {self._order}{', reversed' if self._reverse else ''}"
        text = printable(f"{frames}, {found} {self._source}, {order}")
        return text if report.chain is None else f"{printable(report.chain.text)}\n{text}"

    def _chosen(self, streams: Sequence[Stream]) -> list[Stream]:
        """Filter and sort streams."""
        part, key = self.query_one(Input).value.lower(), ORDERS[self._order]
        found = [one for one in streams if part in f"{one.frame} {one.parent} {one.publisher}".lower()]
        found.sort(key=_name_of)  # in a report, the order of those of one frame varies
        found.sort(key=lambda one: key(one, len(self._problems.get(one.frame, ()))), reverse=self._reverse)
        return found

    def _fill(self, streams: list[Stream]) -> None:
        table = self.query_one(DataTable)
        # None: the first row, which stays highlighted.
        chosen = _name_of(self._streams[table.cursor_row]) if table.cursor_row > 0 else None
        x, y = table.scroll_offset
        table.clear()
        self._streams = streams
        for stream in streams:
            kinds = [one.kind for one in self._problems.get(stream.frame, ())]
            texts = (printable(column.text(stream, kinds)) for column in COLUMNS)
            style = "bold red" if kinds else ""
            table.add_row(*(_cell(*pair, style) for pair in zip(texts, COLUMNS, strict=True)))
        place = next((row for row, one in enumerate(streams) if _name_of(one) == chosen), 0)
        table.move_cursor(row=place, scroll=False)
        table.call_after_refresh(table.scroll_to, x, y, animate=False)

    def on_data_table_row_highlighted(self) -> None:
        self._show_pane("#details", self._details())

    def _show_pane(self, name: str, text: Text) -> None:
        self.query_one(f"{name} Static", Static).update(text)
        self.query_one(name).display = bool(text)

    def _details(self) -> Text:
        """The figures and problems of the stream of the highlighted row."""
        row = self.query_one(DataTable).cursor_row
        if not 0 <= row < len(self._streams):
            return Text()
        stream = self._streams[row]
        text = Text(stream_line(stream))
        for problem in self._problems.get(stream.frame, ()):
            text.append(f"\n{printable(problem.text)}", style="bold red")
        return text

    def _show_log(self) -> None:
        log = self.query_one(RichLog)
        for line in _taken(self._log_file).decode(errors="replace").splitlines():
            log.write(Text(printable(Text.from_ansi(line).plain)))
            log.display = True


def _cell(text: str, column: _Column, style: str = "") -> Text:
    # Not a str, because a name may look like markup.
    return Text(text, style=style, justify="right" if column.is_number else "left", overflow="fold")


def _shortened(kinds: Sequence[str]) -> str:
    unique = list(dict.fromkeys(kinds))
    return f"{unique[0]} +{len(unique) - 1}" if len(unique) > 1 else "".join(unique)


def _name_of(stream: Stream) -> tuple[str, str, int, bool]:
    return stream.frame, stream.parent, stream.publisher_id, stream.static
