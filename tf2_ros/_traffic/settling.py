"""Owns leaving out the transforms that arrive late because their publisher has only just been discovered."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["Settling"]

S = 1_000_000_000
SETTLING_NS = S // 2


class Settling:
    """
    Thins out what a publisher sends in its first half second.

    A middleware delivers together, and late, what was sent while a publisher and a subscriber discovered each
    other; their delays say nothing of the robot. Of each frame and parent the last one is kept, so that
    nothing is missing that is sent only once.
    """

    def __init__(self) -> None:
        self._until_ns: list[int] = []  # of each publisher

    def thinned(self, records: NDArray[np.void]) -> NDArray[np.void]:
        """The records without those; all of them later than those before."""
        publishers, received = records["publisher"], records["received_ns"]
        if not len(records):
            return records
        for publisher in range(len(self._until_ns), int(publishers.max()) + 1):
            first = received[np.argmax(publishers == publisher)]
            self._until_ns.append(int(first) + SETTLING_NS)
        early = (received < np.array(self._until_ns)[publishers]) & (records["static"] == 0)
        if not early.any():
            return records
        chosen = records[early]
        streams = np.stack([chosen[part] for part in ("publisher", "child", "parent")], axis=1)
        _, from_the_end = np.unique(streams[::-1], axis=0, return_index=True)
        kept = ~early
        kept[np.flatnonzero(early)[len(chosen) - 1 - from_the_end]] = True
        thinned: NDArray[np.void] = records[kept]
        return thinned
