# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wait for each change of a transform, in an iteration; ``pending`` has the subscription of ``on_change``."""

from collections.abc import Callable
from typing import Any

from tf2_py import BufferCore, TimeoutException
from tf2_ros._messages import TransformStamped
from tf2_ros._wait.futures import TransformFuture


class Changes:
    """
    An asynchronous iterator over the transforms between two frames, each when it is new.

    :param buffer: kept alive by this.
    :param policy: of ``policy_of``.
    """

    def __init__(self, buffer: BufferCore, target_frame: str, source_frame: str, policy: Any) -> None:
        self._buffer, self._frames, self._policy = buffer, (target_frame, source_frame), policy
        self._begun: Any = None  # the latest wait
        self._delivered: Any = None  # the wait that had the transform delivered last

    def __aiter__(self) -> "Changes":
        return self

    async def __anext__(self) -> TransformStamped:
        found: TransformStamped | None = None
        while found is None:
            try:
                await TransformFuture(self._buffer, self._begin)
            except TimeoutException:  # without a timeout: a shutdown
                raise StopAsyncIteration from None
            found = self._begun.take(again=True)  # None: it has become too old before this ran
        self._delivered = self._begun
        return found

    def _begin(self, core: BufferCore, notify: Callable[[Any], Any]) -> Any:
        self._begun = BufferCore._wait(
            core, *self._frames, 0, notify=notify, policy=self._policy, after=self._delivered
        )
        return self._begun
