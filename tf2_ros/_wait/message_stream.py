"""Owns the asynchronous iteration over what a message filter lets pass."""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Generic, TypeVar

from tf2_ros._wait.waking_future import WakingFuture

__all__ = ["MessageStream"]


_Item = TypeVar("_Item")


class MessageStream(Generic[_Item]):
    """
    An asynchronous iterator over items that another thread puts in; ends, when closed, after the last.

    :param has_ended: whether nothing can be put in any more, because of a shutdown: that ends it, too.

    If several iterate, each item is given to one of them.
    """

    def __init__(self, has_ended: Callable[[], bool]) -> None:
        self._has_ended = has_ended
        self._items: deque[_Item] = deque()
        # Never replaced: one that is about to be added must be found.
        self._awaiting: deque[WakingFuture[None]] = deque()
        self._closed = False

    def put(self, item: _Item) -> None:
        """Let the iteration go on with this."""
        self._items.append(item)
        self._wake()

    def close(self) -> None:
        """End the iteration after what was put in."""
        self._closed = True
        self._wake()

    def __aiter__(self) -> "MessageStream[_Item]":
        return self

    async def __anext__(self) -> _Item:
        while True:
            arrival = _Arrival(self._has_ended)
            # First this, then the check: `put` does it the other way round.
            self._awaiting.append(arrival)
            try:
                return self._items.popleft()
            except IndexError:
                if self._closed or self._has_ended():
                    raise StopAsyncIteration from None
                await arrival
            finally:
                with suppress(ValueError):  # it was woken
                    self._awaiting.remove(arrival)

    def _wake(self) -> None:
        # All of them: a single one may be about to leave. Those that are added later check by themselves.
        for _ in range(len(self._awaiting)):
            with suppress(IndexError):  # one has left
                self._awaiting.popleft().set_result(None)


class _Arrival(WakingFuture[None]):
    """Completed when the iteration is to look again."""

    def end_with_context(self) -> None:
        """Nothing arrives any more."""
        self.set_result(None)
