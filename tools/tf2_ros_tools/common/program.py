# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Read command lines, print and exit in the same way for all programs.

A program is a module of ``tf2_ros_tools.programs`` with a ``PARSER`` and a ``main``. It imports ROS, NumPy
and other libraries after the command line has been read, so that help is fast.
"""

import os
import re
import signal
import sys
import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable
from difflib import get_close_matches
from io import TextIOWrapper
from textwrap import fill
from types import FrameType
from typing import Any, NoReturn

from tf2_py.printable import printable
from tf2_ros_tools.common.optional_libraries import MissingLibraryError

SUCCESS = 0
FAILURE = 1
USAGE = 2
INTERRUPTED = 130

# The last paragraph of the help of commands that run until they are interrupted.
EXIT_STATUS = "Exit status: 0 when interrupted; 1 if the command failed; 2 after wrong usage."

_AGAIN_S = 0.01  # when an interrupt that was dropped is repeated
# Both need ROS, as --namespace does: `--live` refuses them, and its error lists them.
_ROS_ARGS, _QOS = "--ros-args", "--qos-reliability"
_WIDTH = 80  # of the text of a help


class UsageError(Exception):
    """The command line is wrong in a way that only the work itself notices: exit status 2."""


class RunError(Exception):
    """The program failed, for a reason that fits on one line: exit status 1."""


class Parser(ArgumentParser):
    """
    Reads a command line. Wrong usage prints one line and exits with status 2; a negative number is a value.

    :param prog: the name of the program.
    :param description: what it does, in paragraphs that blank lines separate.
    :param example: command lines and what they do, for the end of the help.
    :param node: whether the program has a node, and therefore accepts ``--namespace`` and arguments for ROS.
    :param settings: passed to ``ArgumentParser``.

    A program has either commands (:meth:`add_command`) or arguments.
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
        # argparse takes -1e-3 for an option; calibrations print such numbers.
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$", re.IGNORECASE)
        self._node = node
        self._commands: Any = None  # argparse's action that has them
        self.set_defaults(parser=self)
        if node:
            self.add_argument(
                "--namespace",
                type=_namespace,
                metavar="NS",
                help="put the node into the namespace NS, and use NS/tf and NS/tf_static",
            )

    def add_command(self, name: str, summary: str, example: str, more: str = "") -> "Parser":
        """
        Add a command, which is the first argument of the command line and has its own arguments.

        :param summary: what it does, in a sentence without a full stop that begins in lower case.
        :param more: further paragraphs of its help.
        :return: the parser of its arguments.
        """
        if self._commands is None:
            self._commands = self.add_subparsers(
                title="commands", metavar="COMMAND", dest="command", required=True
            )
        text = "\n\n".join(filter(None, (f"{summary[0].upper()}{summary[1:]}.", more)))
        made: Parser = self._commands.add_parser(
            name, help=summary, description=text, example=example, node=self._node
        )
        return made

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with status 2."""
        self.fail(f"{' '.join(message.split())} (see {self.prog} --help)", USAGE)

    def fail(self, reason: str, status: int = FAILURE) -> NoReturn:
        """Print one line and exit."""
        self.exit(status, self._line(reason))

    def warn(self, text: str) -> None:
        """Print one line to standard error."""
        sys.stderr.write(self._line(text))

    def _line(self, text: str) -> str:
        return printable(f"{self.prog}: {' '.join(text.split())}") + "\n"

    def read(self, arguments: list[str]) -> Namespace:
        """
        Read a command line.

        :param arguments: including the name of the program and the arguments for ROS.
        :return: the options, with ``ros_arguments`` for ``rclpy.init``, the ``parser`` that has read them,
            and the name of the ``command``, if the program has any.
        """
        self._refuse_ros_with_live(arguments)
        own = self._without_ros_arguments(arguments)[1:]
        parse = self.parse_known_args if self._commands else self.parse_known_intermixed_args
        read, unknown = parse(own)
        if unknown:
            read.parser.refuse(unknown)
        read.ros_arguments = [*arguments]
        if self._node and read.namespace is not None:
            remaps = (f"__ns:={read.namespace}", "/tf:=tf", "/tf_static:=tf_static")
            # Behind the user's own, the first of which is taken.
            read.ros_arguments += [_ROS_ARGS, *(part for one in remaps for part in ("-r", one))]
        return read

    def refuse(self, unknown: list[str]) -> NoReturn:
        """Say which arguments are unknown, and which options have similar names."""
        options = [name for name in self._option_string_actions if name.startswith("--")]
        names = [one.partition("=")[0] for one in unknown if one.startswith("--")]
        near = [match for name in names for match in get_close_matches(name, options, n=1, cutoff=0.8)]
        advice = f"; did you mean {' and '.join(dict.fromkeys(near))}?" if near else ""
        self.error(f"unrecognized arguments: {' '.join(unknown)}{advice}")

    def _refuse_ros_with_live(self, arguments: list[str]) -> None:
        # Before anything imports rclpy, which need not be there.
        names = {one.partition("=")[0] for one in arguments}
        of_ros = {_ROS_ARGS, "--namespace", _QOS}
        if "--live" in self._option_string_actions and "--live" in names and names & of_ros:
            self.error(f"--live cannot be combined with {self.listed_of_ros()}")

    def listed_of_ros(self) -> str:
        """List the options that need ROS in a text."""
        return f"--namespace{f', {_QOS}' * (_QOS in self._option_string_actions)} or {_ROS_ARGS}"

    def _without_ros_arguments(self, arguments: list[str]) -> list[str]:
        if not self._node or _ROS_ARGS not in arguments:
            return arguments  # help needs no rclpy then
        from rclpy.utilities import remove_ros_args

        try:
            removed: list[str] = remove_ros_args(arguments)
        except RuntimeError as refusal:  # the base of what rclpy raises for them
            self.error(f"{_ROS_ARGS}: {refusal}")
        return removed


def _namespace(text: str) -> str:
    if not re.fullmatch(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", text, re.ASCII):
        raise ArgumentTypeError(f"expected a namespace such as robot1, got {text!r}")
    return f"/{text.removeprefix('/')}"


def run(
    parser: Parser,
    work: Callable[[Namespace], int],
    arguments: list[str] | None = None,
    *,
    interrupted: int = INTERRUPTED,
) -> int:
    """
    Run a program. This must be the last call of a process.

    :param work: gets the options and returns the exit status. It may raise UsageError, RunError or
        OSError, and imports what it needs.
    :param arguments: the command line, including the name of the program. None: that of this process.
    :param interrupted: the exit status after Ctrl-C; SUCCESS for a program that usually ends this way.
    :return: the exit status.
    :raises SystemExit: after wrong usage and after the help.
    """
    arguments = sys.argv if arguments is None else arguments
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    sys.unraisablehook = _after_unraisable
    if sys.stdout is None:  # closed; the next file that is opened would have its number
        sys.stdout = open(os.devnull, "w")
    try:
        if isinstance(sys.stdout, TextIOWrapper):
            # The reader of a pipe may wait for a line, and the name of a frame may not be in the encoding.
            sys.stdout.reconfigure(errors="backslashreplace", line_buffering=True)
        try:
            options = parser.read(arguments)
        finally:
            sys.stdout.flush()  # argparse ignores that its help cannot be written, and Python would try again
        parser = options.parser
        return work(options)
    except KeyboardInterrupt:
        return interrupted
    except UsageError as refusal:
        parser.error(str(refusal))
    except (RunError, MissingLibraryError) as failure:
        parser.fail(str(failure))
    except ImportError as lack:
        if _was_interrupted():  # rclpy says that its library cannot be imported
            return interrupted
        # The error of this project's tf2_ros says what it needs, but another tf2_ros may have been imported.
        parser.fail(f"{lack}; tf2_which shows which tf2_ros is imported")
    except OSError as failure:
        if failure.filename is not None:
            parser.fail(f"{failure.filename}: {failure.strerror}")
        # From writing to standard output. What is left of it would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(failure, BrokenPipeError):  # a reader who leaves has seen enough
            parser.fail(failure.strerror or str(failure))
        return FAILURE
    except Exception:
        if _was_interrupted():
            return interrupted  # what rclpy's bindings make of it while they convert an argument
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _was_interrupted() -> bool:
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def _interrupt(number: int, _: FrameType | None) -> None:
    # Launchers pass on the Ctrl-C that the terminal has sent to all: a second one must not interrupt the end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    raise KeyboardInterrupt


def _after_unraisable(dropped: Any) -> None:
    # Python drops what a handler raises in a finalizer. Then the program is interrupted a little later.
    if issubclass(dropped.exc_type, KeyboardInterrupt):
        signal.signal(signal.SIGALRM, _interrupt)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
    else:
        sys.__unraisablehook__(dropped)


def wait_until_interrupted() -> NoReturn:
    """Wait in the main thread until Ctrl-C or SIGTERM."""
    while True:
        time.sleep(1.0)
