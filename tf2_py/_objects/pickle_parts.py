"""
Pickle the state of a buffer in parts, between which other threads run.

Pickling or loading an array, or a list of tuples, is one call in C, which keeps the GIL until it ends.
"""

from itertools import chain
from typing import Any

# The arrays and lists of a state, and into how many elements they are divided. A part takes about 1 ms.
LENGTHS = {"frames": 1024, "stamps": 16384, "transforms": 16384, "parents": 16384, "parent_names": 1024}


class DividedState(dict[str, Any]):
    """A state that is divided when it is pickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        rest = {key: value for key, value in self.items() if key not in LENGTHS}
        count = max(1, *(-(-len(self[key]) // length) for key, length in LENGTHS.items()))
        return joined, (rest, *(_Part(self, number) for number in range(count)))


class _Part:
    """The slices of all arrays and lists of a state that have the same number."""

    def __init__(self, state: DividedState, number: int) -> None:
        self._state, self._number = state, number

    def __reduce__(self) -> tuple[Any, ...]:
        slices = ((self._state[key], length * self._number, length) for key, length in LENGTHS.items())
        return part, tuple(value[start : start + length] for value, start, length in slices)


# Pickles refer to these two by name.


def part(*slices: Any) -> tuple[Any, ...]:
    """Return the slices of one part. Other threads run when this is called, because it is not in C."""
    return slices


def joined(rest: dict[str, Any], *parts: tuple[Any, ...]) -> dict[str, Any]:
    """Join the parts of a state, and add the rest of it."""
    import numpy as np

    state = dict(rest)
    for key, slices in zip(LENGTHS, zip(*parts, strict=True), strict=True):
        is_list = isinstance(slices[0], list)
        state[key] = list(chain.from_iterable(slices)) if is_list else np.concatenate(slices)
    return state
