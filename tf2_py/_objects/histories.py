"""Owns the samples of a buffer, frame by frame, as arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["COUNT", "FRAME_COLUMNS", "KIND", "STATIC_KIND", "History", "histories"]

FRAME_COLUMNS, KIND, COUNT = 6, 0, 1  # of a state's `frames`: how many, and two of them
STATIC_KIND = 2  # of the kinds of a Cache: CACHE_STATIC


class History(NamedTuple):
    """The N samples of one frame, oldest first; a static frame has one."""

    frame: str
    static: bool
    parents: NDArray[np.object_]  # (N,), names: of each sample, whose parent need not be that of the next
    stamps_ns: NDArray[np.int64]  # (N,); 0 for a static frame
    translations: NDArray[np.float64]  # (N, 3), metres
    rotations: NDArray[np.float64]  # (N, 4), x y z w


def histories(state: Mapping[str, Any]) -> Iterator[History]:
    """
    The histories that are not empty, of a state as ``BufferCore.__getstate__`` returns it.

    The numbers are views of the state's.
    """
    import numpy as np

    names = np.array(state["names"].decode("utf-8").split("\0")[:-1], object)
    end = 0
    for name, (kind, count) in zip(names, state["frames"][:, [KIND, COUNT]].tolist(), strict=True):
        begin, end = end, end + count
        if count:
            transforms = state["transforms"][begin:end]
            parents = names[state["parents"][begin:end] - 1]
            stamps_ns = state["stamps"][begin:end]
            yield History(name, kind == STATIC_KIND, parents, stamps_ns, transforms[:, :3], transforms[:, 3:])
