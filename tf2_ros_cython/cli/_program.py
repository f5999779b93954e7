"""
Owns the manners of all programs: how they read their command lines, obey signals, print, and end.

A program is two modules of its name: one here, with the command line and ``main``, and one in ``tf2_ros.cli``
with the work, which may import ROS. The first imports the second when the command line has been read.

Exit statuses: 0 and 1 are the program's own; 2 is wrong usage; 128 and a signal's number, ended by the signal
before there was a result, or by a reader of its output who left.
"""

import os
import signal
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from select import select
from socket import socketpair
from textwrap import fill
from time import monotonic
from types import FrameType
from typing import Any, NoReturn, TextIO

from tf2_ros_cython.cli._numbers import is_negative_number

__all__ = [
    "ENDINGS",
    "FAILURE",
    "SUCCESS",
    "USAGE",
    "Parser",
    "RunError",
    "UsageError",
    "deferred_signals",
    "interruptible",
    "raise_if_signalled",
    "run",
    "sleep",
    "wait_for_signal",
]

SUCCESS = 0
FAILURE = 1
USAGE = 2
_BY_SIGNAL = 128

_ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM)
# After a signal, until a further one ends the program at once. Launchers pass on the Ctrl-C that the terminal
# has sent to all.
FAREWELL_S = 1.0

_ROS_ARGS = "--ros-args"
_WIDTH = 80  # of the text of a help


class UsageError(Exception):
    """What was asked for cannot be done, which shows only after the command line was read: exit status 2."""


class RunError(Exception):
    """What was asked for failed, for a reason that one line says: exit status 1."""


class _Signalled(KeyboardInterrupt):
    """A signal asks the program to end."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


# What ends a program from outside. One for which that is the ordinary end, or that has a result, catches it.
ENDINGS = (KeyboardInterrupt, BrokenPipeError)


class Parser(ArgumentParser):
    """
    Reads a command line: wrong usage is one line and status 2, a negative number is a value.

    :param prog: the name of the program.
    :param description: what it does, in paragraphs, with a blank line between two of them.
    :param example: command lines with what they do, for the end of the help.
    :param node: whether the program has a node, and so takes arguments for ROS.
    :param settings: of ``ArgumentParser``.

    A program that does several things has commands: :meth:`add_command`. It has no arguments of its own then.
    """

    def __init__(
        self, prog: str, description: str, example: str, *, node: bool = True, **settings: Any
    ) -> None:
        of_ros = f"{_ROS_ARGS} begins arguments for ROS: remappings, parameters, log levels.\n\n"
        super().__init__(
            prog=prog,
            description="\n\n".join(fill(one, _WIDTH) for one in description.split("\n\n")),
            epilog=f"{of_ros if node else ''}example:\n{example}",
            formatter_class=RawDescriptionHelpFormatter,
            # Scripts must mean the same when a later version has more options.
            allow_abbrev=False,
            **settings,
        )
        self.register("type", None, _as_given)  # of an argument without a type
        self._node = node
        self._commands: Any = None  # argparse's action that has them

    def add_command(self, name: str, summary: str, description: str, example: str) -> "Parser":
        """
        Add a command: the first argument of a command line, with arguments of its own.

        :param summary: a line for the help of the program; the others are as of :class:`Parser`.
        :return: what reads its arguments.
        """
        if self._commands is None:
            self._commands = self.add_subparsers(title="commands", metavar="COMMAND", dest="command")
            self._commands.required = True
        made: Parser = self._commands.add_parser(
            name, help=summary, description=description, example=example, node=self._node
        )
        return made

    def error(self, message: str) -> NoReturn:
        """End with status 2 and one line."""
        line = " ".join(message.split())
        self.exit(USAGE, f"{self.prog}: {line} (see {self.prog} --help)\n")

    def read(self, arguments: list[str]) -> Namespace:
        """
        Read a command line.

        :param arguments: with the name of the program, and with what is for ROS.
        :return: the options; their ``ros_arguments`` is what ``rclpy.init`` needs. ``parser`` has read them,
            and ``command`` is the name of the command, where there are some.
        """
        own = [_as_value(one) for one in self._without_ros_arguments(arguments)[1:]]
        read = Namespace(ros_arguments=arguments, parser=self, command=None)
        if self._commands is None:
            return self.parse_intermixed_args(own, read)
        if not own or own[0] not in self._commands.choices:
            return self.parse_args(own, read)  # help, or wrong usage
        # What argparse does with commands, but for options between the arguments of one.
        read.command = own[0]
        read.parser = self._commands.choices[own[0]]
        options: Namespace = read.parser.parse_intermixed_args(own[1:], read)
        return options

    def _without_ros_arguments(self, arguments: list[str]) -> list[str]:
        if not self._node or _ROS_ARGS not in arguments:
            return arguments  # help needs no rclpy then
        from rclpy.utilities import remove_ros_args

        try:
            removed: list[str] = remove_ros_args(arguments)
        except RuntimeError as refusal:  # the base of what rclpy raises for them
            self.error(f"{_ROS_ARGS}: {refusal}")
        return removed


def _as_value(argument: str) -> str:
    # argparse takes what begins with a minus for an option, except for the plainest numbers. strtod skips
    # blanks before a number, and so does what reads it here.
    return f" {argument}" if is_negative_number(argument) else argument


def _as_given(value: str) -> str:
    return value[1:] if value.startswith(" ") and is_negative_number(value[1:]) else value


def run(parser: Parser, work: str, arguments: list[str] | None = None) -> int:
    """
    Run a program: the last call of a process.

    :param work: ``module:function``, imported when the command line was read. It gets the options, and
        returns the exit status. It raises UsageError, RunError, or one of ENDINGS.
    :param arguments: the command line, with the name of the program. None: that of the process.
    :return: the exit status.
    :raises SystemExit: for wrong usage, and after the help.
    """
    arguments = sys.argv if arguments is None else arguments
    _signals.listen()
    try:
        _complete(parser)
        _flush_each_line(sys.stdout)
        try:
            options = parser.read(arguments)
            do = _function(work)
            parser = options.parser
        except ImportError as lack:
            # tf2_ros says itself what it needs; it may also be another project's.
            reason = " ".join(str(lack).split())
            parser.exit(FAILURE, f"{parser.prog}: {reason}; tf2_which tells which tf2_ros is imported\n")
        return do(options)
    except UsageError as refusal:
        parser.error(str(refusal))
    except RunError as failure:
        parser.exit(FAILURE, f"{parser.prog}: {' '.join(str(failure).split())}\n")
    except _Signalled as ending:
        return _BY_SIGNAL + ending.number
    except BrokenPipeError:
        return _BY_SIGNAL + signal.SIGPIPE
    except OSError as failure:
        # Of the output; what else cannot be read or written, the work refuses itself.
        parser.exit(FAILURE, f"{parser.prog}: {failure.strerror or failure}\n")
    finally:
        _signals.may_raise = False
        _let_go(sys.stdout)
        _signals.ignore_repeated()


class _Signals:
    """Which signal came, and whether one may be raised now."""

    def __init__(self) -> None:
        self.received: int | None = None
        self.since = 0.0  # of the monotonic clock
        self.may_raise = True
        self.reader, self._writer = socketpair()  # readable after the first signal

    def listen(self) -> None:
        """Handle the signals that end a program."""
        self._writer.setblocking(False)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        for number in _ENDING_SIGNALS:
            signal.signal(number, self.receive)

    def ignore_repeated(self) -> None:
        """From now on: the interpreter ends, and gives back to its signals what they do without it."""
        if self.received is None:
            return
        report = sys.unraisablehook
        # Of a signal that came just before, Python reports by this hook that it is ignored.
        sys.unraisablehook = lambda told: None if isinstance(told.exc_value, OSError) else report(told)
        try:
            for number in _ENDING_SIGNALS:
                signal.signal(number, signal.SIG_IGN)
        finally:
            sys.unraisablehook = report

    def receive(self, number: int, _: FrameType | None) -> None:
        if self.received is None:
            self.received, self.since = number, monotonic()
            if self.may_raise:
                raise _Signalled(number)
        elif monotonic() - self.since > FAREWELL_S:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)


_signals = _Signals()


@contextmanager
def deferred_signals() -> Iterator[None]:
    """
    Let no signal interrupt what is set up or cleaned up in a ``with`` block, which must not last long.

    Interrupted there, a program could leave other nodes waiting for it, or not end at all.
    """
    before, _signals.may_raise = _signals.may_raise, False
    try:
        yield
    finally:
        _signals.may_raise = before


@contextmanager
def interruptible() -> Iterator[None]:
    """Inside :func:`deferred_signals`: let one interrupt a ``with`` block, also one that came before it."""
    before, _signals.may_raise = _signals.may_raise, True
    try:
        if _signals.received is not None:
            raise _Signalled(_signals.received)
        yield
    finally:
        _signals.may_raise = before


def wait_for_signal() -> None:
    """Wait for Ctrl-C or SIGTERM, in the main thread of a program for which that is the ordinary end."""
    with suppress(KeyboardInterrupt), interruptible():
        while True:
            sleep(None)


def sleep(seconds: float | None) -> None:
    """
    Wait so long, or until a signal.

    :param seconds: 0 or above. None: for ever.

    Any other wait sleeps on if the signal reaches a thread that is not Python's, or comes just before it.
    """
    select([_signals.reader], [], [], seconds)
    raise_if_signalled()


def raise_if_signalled() -> None:
    """
    End the program if a signal has come, and one may be raised now.

    It came while signals were deferred, or a library has caught what was raised.
    """
    if _signals.received is not None and _signals.may_raise:
        raise _Signalled(_signals.received)


def _complete(parser: Parser) -> None:
    """Answer a shell that asks for completions, and end; otherwise do nothing."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    try:
        import argcomplete
    except ModuleNotFoundError:
        return
    argcomplete.autocomplete(parser)


def _flush_each_line(stream: TextIO) -> None:
    # Also into a pipe, where a reader waits for it.
    reconfigure = getattr(stream, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(line_buffering=True)


def _let_go(stream: TextIO) -> None:
    """Write what is left; where that fails, leave nothing that the interpreter would fail to write."""
    try:
        if stream is not None:
            stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _function(work: str) -> Callable[[Namespace], int]:
    module, _, name = work.partition(":")
    function: Callable[[Namespace], int] = getattr(import_module(module), name)
    return function
