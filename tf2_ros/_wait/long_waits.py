"""Owns the log of waits that last long, with what each lacks; programs ask for it with TF2_DEBUG=1."""

import os
import time
from collections.abc import Collection
from typing import Any

from tf2_py._internal import log
from tf2_ros._wait.deadlines import deadlines

__all__ = ["DEBUG", "LongWait", "report_if_long"]

DEBUG = os.environ.get("TF2_DEBUG") == "1"
LONG_S = 1


class LongWait:
    """What is logged, once, if the waits of one lookup or one message last longer than LONG_S."""

    def __init__(self, waits: Collection[Any]) -> None:
        self._waits = waits

    def over(self) -> bool:
        """Whether none of them is pending."""
        return not self._waits

    def expire(self) -> None:
        """They have lasted long."""
        for wait in list(self._waits):
            # One that is about to be answered lacks nothing.
            if wait.reason() is not None:
                log.logger("tf2_ros").warning(f"After {LONG_S} s, a lookup still {wait.lacks()}")


def report_if_long(waits: Collection[Any]) -> LongWait | None:
    """
    Log what waits lack, if they are pending for long; without effect where TF2_DEBUG is not set.

    :param waits: those of one lookup or one message; may change, and is empty when none is pending.
    :return: to be kept as long as one of them may be pending.
    """
    if not DEBUG:
        return None
    report = LongWait(waits)
    deadlines.add(time.monotonic_ns() + LONG_S * 10**9, report)
    return report
