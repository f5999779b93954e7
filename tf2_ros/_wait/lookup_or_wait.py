# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The arguments of a lookup, which asks at once, blocks a thread, or begins a wait."""

import time
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from tf2_py import BufferCore, TransformException
from tf2_py._internal import errors, log, time_ns
from tf2_ros._running_loop import running_loop
from tf2_ros._sources import Shutdown


def warn_in_a_loop() -> None:
    """Warn, once in this process, if a lookup blocks a thread in which an asyncio loop runs."""
    if running_loop() is not None:
        _warn_of_stalled_loop()


@cache
def _warn_of_stalled_loop() -> None:
    log.logger("tf2_ros").warning(
        "A lookup blocks the thread of an asyncio loop, which stands still until the lookup returns. Await "
        "lookup_transform_async, transform_async or lookup_transform_full_async instead."
    )


class Lookup(NamedTuple):
    """
    The arguments of a lookup, in the order of ``BufferCore._tf2_look_up``.

    A simple lookup has one time, its ``source_time``. For the ``policy``, see ``policy_of``.
    """

    target_frame: str
    source_frame: str
    source_time: Any
    fixed_frame: str | None = None
    target_time: Any = None
    policy: Any = None

    def is_latest(self) -> bool:
        """Whether it asks for the latest transform, at one of its times."""
        times = (self.source_time,) if self.fixed_frame is None else (self.source_time, self.target_time)
        return any(time_ns(one, "time") == 0 for one in times)

    def now(self, core: BufferCore, or_none: bool = False) -> Any:
        """Look up without a wait: return the answer, or raise the error; if ``or_none``, return None."""
        return BufferCore._tf2_look_up(core, *self, or_none)

    def wait(self, core: BufferCore, notify: Callable[[Any], Any] | None = None) -> Any:
        """
        Begin to wait; see ``BufferCore._wait``. A program's method of that name does not replace it.

        :param notify: called with the answer. None: a thread is about to block.
        """
        return BufferCore._wait(core, *self[:-1], notify=notify, policy=self.policy)

    def block(self, core: BufferCore, timeout_ns: int, or_none: bool = False) -> Any:
        """
        Wait in this thread, without the GIL, until there is an answer, and return it.

        :param timeout_ns: nanoseconds of steady time, at most FOR_EVER_NS. 0 or less: do not wait.
        :param or_none: return None if there is no answer in time, which is faster than an error.
        :raises TransformException: what the lookup raises. After a wait, its text also says how long that
            took, or which :class:`Shutdown` ended it.
        """
        if timeout_ns <= 0:
            return self.now(core, or_none)
        is_in_vain = Shutdown(core)
        begin_ns = time.monotonic_ns()
        wait = self.wait(core)
        answer = wait.take()
        if answer is None:
            warn_in_a_loop()
            answer = wait.wait_for(timeout_ns, is_in_vain)
        if answer is not None:
            return answer
        try:
            return self.now(core, or_none)  # something may have arrived right at the end
        except (TransformException, ValueError) as reason:
            waited_ns = min(time.monotonic_ns() - begin_ns, timeout_ns)
            why = is_in_vain.why()
            text = errors.in_vain(why, waited_ns) if why else errors.after_wait(str(reason), waited_ns)
            raise type(reason)(text) from None

    def can(self, core: BufferCore, timeout_ns: int, with_reason: bool) -> bool | tuple[bool, str]:
        """Whether :meth:`block` returns an answer; or also why not, which takes longer to say."""
        can, reason = False, ""
        try:
            can = self.block(core, timeout_ns, not with_reason) is not None
        except TransformException as error:
            reason = str(error)
        return (can, reason) if with_reason else can

    @property
    def judges_age(self) -> bool:
        """Whether an answer that was accepted may have become too old before it is returned."""
        return self.policy is not None and self.policy.judges_age
