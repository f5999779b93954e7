"""
Owns the manners of all programs: how they read their command lines, obey signals, print, and end.

A program is two modules of its name: one here, with the command line and ``main``, and one in ``tf2_ros.cli``
with the work, which imports ROS. The first imports the second when the command line has been read.

Exit statuses: 0 and 1 are the program's own; 2 is wrong usage; 128 and a signal's number, ended by the signal
before there was a result, or by a reader of its output who left.
"""

import os
import signal
import sys
import threading
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from contextlib import suppress
from importlib import import_module
from textwrap import fill
from time import monotonic
from types import FrameType
from typing import Any, NoReturn, TextIO

from tf2_ros_cython.cli._numbers import is_negative_number

__all__ = ["ENDINGS", "FAILURE", "SUCCESS", "USAGE", "Parser", "UsageError", "run", "wait_for_signal"]

SUCCESS = 0
FAILURE = 1
USAGE = 2
_BY_SIGNAL = 128

_ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM)
FAREWELL_S = 1.0  # after a signal; until then further ones change nothing

_ROS_ARGS = "--ros-args"
_WIDTH = 80  # of the text of a help


class UsageError(Exception):
    """What was asked for cannot be done, which shows only after the command line was read: exit status 2."""


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

    :param name: of the program.
    :param description: what it does, in paragraphs, with a blank line between two of them.
    :param example: command lines with what they do, for the end of the help.
    """

    def __init__(self, name: str, description: str, example: str) -> None:
        super().__init__(
            prog=name,
            description="\n\n".join(fill(one, _WIDTH) for one in description.split("\n\n")),
            epilog=f"{_ROS_ARGS} begins arguments for ROS: remappings, parameters, log levels.\n\n"
            f"example:\n{example}",
            formatter_class=RawDescriptionHelpFormatter,
            # Scripts must mean the same when a later version has more options.
            allow_abbrev=False,
        )
        self.register("type", None, _as_given)  # of an argument without a type

    def error(self, message: str) -> NoReturn:
        """End with status 2 and one line."""
        line = " ".join(message.split())
        self.exit(USAGE, f"{self.prog}: {line} (see {self.prog} --help)\n")

    def read(self, arguments: list[str]) -> Namespace:
        """
        Read a command line.

        :param arguments: with the name of the program, and with what is for ROS.
        :return: the options; their ``ros_arguments`` is what ``rclpy.init`` needs.
        """
        own = [_as_value(one) for one in self._without_ros_arguments(arguments)[1:]]
        return self.parse_intermixed_args(own, Namespace(ros_arguments=arguments))

    def _without_ros_arguments(self, arguments: list[str]) -> list[str]:
        if _ROS_ARGS not in arguments:
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
        returns the exit status. It raises UsageError, or one of ENDINGS.
    :param arguments: the command line, with the name of the program. None: that of the process.
    :return: the exit status.
    :raises SystemExit: for wrong usage, and after the help.
    """
    arguments = sys.argv if arguments is None else arguments
    for number in _ENDING_SIGNALS:
        signal.signal(number, _end)
    try:
        _complete(parser)
        _flush_each_line(sys.stdout)
        options = parser.read(arguments)
        return _function(parser, work)(options)
    except UsageError as refusal:
        parser.error(str(refusal))
    except _Signalled as ending:
        return _BY_SIGNAL + ending.number
    except BrokenPipeError:
        return _BY_SIGNAL + signal.SIGPIPE
    finally:
        _let_go(sys.stdout)


def wait_for_signal() -> None:
    """Wait for Ctrl-C or SIGTERM, in the main thread of a program for which that is the ordinary end."""
    with suppress(KeyboardInterrupt):
        threading.Event().wait()


def _end(number: int, _: FrameType | None) -> NoReturn:
    first = monotonic()

    def end_again(number: int, _: FrameType | None) -> None:
        # Launchers pass on the Ctrl-C that the terminal has sent to all. To be ended amid its farewell to the
        # other nodes would leave them waiting for this one.
        if monotonic() - first > FAREWELL_S:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    for handled in _ENDING_SIGNALS:
        signal.signal(handled, end_again)
    raise _Signalled(number)


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
    """Write what is left; without a reader, leave nothing that the interpreter would fail to write."""
    try:
        if stream is not None:
            stream.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _function(parser: Parser, work: str) -> Any:
    module, _, function = work.partition(":")
    try:
        return getattr(import_module(module), function)
    except ImportError as lack:
        # tf2_ros says itself what it needs; it may also be another project's.
        parser.exit(FAILURE, f"{parser.prog}: {lack}; tf2_which tells which tf2_ros is imported\n")
