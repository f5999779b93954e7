"""Wait for a lookup in the calling thread."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from tf2_py import BufferCore, InvalidArgumentException, TransformException
from tf2_py._internal import errors
from tf2_ros_cython._presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from tf2_ros._nodes import Shutdown
else:
    from tf2_ros._without_ros import Shutdown


class Lookup(NamedTuple):
    """
    The arguments of a lookup, in the order of ``BufferCore._look_up``.

    A simple lookup has one time, its ``source_time``. For the ``policy``, see ``policy_of``.
    """

    target_frame: str
    source_frame: str
    source_time: Any
    fixed_frame: str | None = None
    target_time: Any = None
    policy: Any = None

    @classmethod
    def of(cls, *arguments: Any, policy: Any = None) -> "Lookup":
        """The lookup of ``lookup_transform`` with three arguments, of ``lookup_transform_full`` with five."""
        if len(arguments) == 3:
            return cls(*arguments, policy=policy)
        target_frame, target_time, source_frame, source_time, fixed_frame = arguments
        return cls(target_frame, source_frame, source_time, fixed_frame, target_time, policy)

    def now(self, core: BufferCore) -> Any:
        """Look up without a wait: return the answer or raise the error."""
        return BufferCore._look_up(core, *self)

    def wait(self, core: BufferCore, notify: Callable[[Any], Any] | None = None) -> Any:
        """
        Begin to wait; see ``BufferCore._wait``. A program's method of that name does not replace it.

        :param notify: called with the answer. None: a thread is about to block.
        """
        return BufferCore._wait(core, *self[:-1], notify=notify, policy=self.policy)


class BlockingWait:
    """
    A wait of the calling thread, which begins when this is made.

    :param core: the buffer, whose :class:`Shutdown` ends the wait.
    :param timeout_ns: nanoseconds of steady time, at most FOR_EVER_NS. 0 or less: there is no wait.
    """

    def __init__(self, core: BufferCore, timeout_ns: int) -> None:
        self._core = core
        self._shutdown = Shutdown(core)
        self._timeout_ns = timeout_ns
        self._begin_ns = time.monotonic_ns()
        self._waits = timeout_ns > 0

    def for_answer(self, lookup: Lookup) -> Any:
        """
        Wait, without the GIL, until there is an answer, and return it.

        When the wait has ended, raise what the lookup raises, with the text of :meth:`told`. For an invalid
        name, raise at once.
        """
        if not self._waits:
            return lookup.now(self._core)
        while True:
            try:
                wait = lookup.wait(self._core)
            except TransformException:
                self._waits = False
                raise
            answer = wait.answer
            if answer is not None:
                return answer
            if wait.wait_for(self._timeout_ns, self._alive):
                return wait.answer
            reason = wait.reason()
            if reason is not None:
                raise self.error(reason)
            # It has arrived between the two, and the next lookup finds it.

    def told(self, reason: str) -> str:
        """Add to the reason of the lookup how long the wait took; or say what ended it."""
        if not self._waits:
            return reason
        waited_ns = min(time.monotonic_ns() - self._begin_ns, self._timeout_ns)
        return errors.after_wait(reason, waited_ns) if self._alive() else errors.shut_down(waited_ns)

    def error(self, error: TransformException) -> TransformException:
        """
        Add the same to an error of the lookup. Its class remains, because programs catch it.

        The error of an invalid argument remains as it is, because no wait would have helped.
        """
        if isinstance(error, InvalidArgumentException):
            return error
        text = str(error)
        told = self.told(text)
        return error if told == text else type(error)(told)

    def _alive(self) -> bool:
        return not self._shutdown.happened()
