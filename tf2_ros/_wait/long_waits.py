"""Owns the log of waits that last long, with what each lacks; programs ask for it with TF2_DEBUG=1."""

import os
import time
from collections.abc import Collection
from typing import Any

from tf2_py._internal import log
from tf2_ros._wait.deadlines import deadlines

__all__ = ["DEBUG", "LongWait", "report_if_long"]

DEBUG = os.environ.get("TF2_DEBUG") == "1"
# Soon; and once more when all publishers must have been discovered, for the first time is often before that.
AFTER_S = (1, 10)


class LongWait:
    """What is logged if the waits of one lookup or one message last longer than AFTER_S."""

    def __init__(self, waits: Collection[Any]) -> None:
        self._waits = waits
        self._begin_ns = time.monotonic_ns()
        self._logged = 0
        self._wait_on()

    def over(self) -> bool:
        """Whether none of them is pending."""
        return not self._waits

    def expire(self) -> None:
        """They have lasted long."""
        after_s = AFTER_S[self._logged]
        for wait in list(self._waits):
            # One that is about to be answered lacks nothing.
            if wait.reason() is not None:
                log.logger("tf2_ros").warning(f"After {after_s} s, a lookup still {wait.lacks()}")
        self._logged += 1
        if self._logged < len(AFTER_S):
            self._wait_on()

    def _wait_on(self) -> None:
        deadlines.add(self._begin_ns + AFTER_S[self._logged] * 10**9, self)


def report_if_long(waits: Collection[Any]) -> LongWait | None:
    """
    Log what waits lack, if they are pending for long; without effect where TF2_DEBUG is not set.

    :param waits: those of one lookup or one message; may change, and is empty when none is pending.
    :return: to be kept as long as one of them may be pending.
    """
    return LongWait(waits) if DEBUG else None
