"""Run a signal handler before a chosen line of this project's Python, where a signal would hit by chance."""

import linecache
import sys
from contextlib import contextmanager

import tf2_py
import tf2_ros

PACKAGES = (*tf2_py.__path__, *tf2_ros.__path__)  # installed, they are not beside the tests


class Interrupt(BaseException):
    """What the handler raises."""


class Count:
    """How far the lines were counted."""

    def __init__(self, line):
        self.left = line
        self.reached = False


def _text(frame):
    return linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()


def _raise():
    raise Interrupt


@contextmanager
def interrupted(line, handler=_raise):
    """Call a handler once, before the line with this number, from 1, of those that the packages run."""
    count = Count(line)

    def trace(frame, event, _):
        if not frame.f_code.co_filename.startswith(PACKAGES):
            return None
        # A `with` is traced a second time before its end, where no signal is handled.
        if event == "line" and not _text(frame).startswith("with "):
            count.left -= 1
            if count.left == 0:
                count.reached = True
                sys.settrace(None)
                handler()
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        yield count
    except Interrupt:
        pass
    finally:
        sys.settrace(before)
