"""Owns turning what callers pass as times or points into NumPy arrays of one dtype and shape."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from tf2_py._objects.times import time_ns

if TYPE_CHECKING:
    import numpy as np

# NumPy is imported with the first call that needs it: the engine itself does without.


def new_rows(count: int, width: int) -> np.ndarray:
    """An uninitialised float64 array of shape (count, width)."""
    import numpy as np

    return np.empty((count, width))


def new_array(shape: tuple[int, ...], dtype: str) -> np.ndarray:
    """An uninitialised array."""
    import numpy as np

    return np.empty(shape, dtype)


def received_array(value: Any, shape: tuple[int | None, ...], dtype: str) -> np.ndarray:
    """
    An array that somebody else made, contiguous, aligned and in this machine's byte order; a copy if need be.

    :param shape: what it must be; None: any.
    :param dtype: what it must be, in either byte order.
    :raises ValueError: it is another; the text goes on after the name of the array.
    """
    import numpy as np

    if type(value) is not np.ndarray:
        raise ValueError(f"is no array but {type(value).__name__}")
    if value.dtype.newbyteorder("=") != np.dtype(dtype):
        raise ValueError(f"is of dtype {value.dtype}, not {dtype}")
    if value.ndim != len(shape) or any(w not in (None, n) for w, n in zip(shape, value.shape, strict=True)):
        wanted = ", ".join("N" if w is None else str(w) for w in shape)
        raise ValueError(f"is of shape {value.shape}, not ({wanted})")
    return np.require(value, dtype, ["C_CONTIGUOUS", "ALIGNED"])


def mask_of(values: Any) -> np.ndarray | None:
    """
    The mask of a masked array of NumPy; None where nothing is masked, and of anything else.

    Not by ``numpy.ma``, which NumPy imports when it is first used: a fork meanwhile would leave the lock of
    that import taken.
    """
    import numpy as np

    mask = getattr(values, "mask", None)
    return mask if isinstance(mask, np.ndarray) else None


def as_times_ns(times: Any) -> np.ndarray:
    """Times as contiguous int64 nanoseconds of shape (N,); TypeError or ValueError says what is wanted."""
    import numpy as np

    wanted = "times must be integer nanoseconds of shape (N,), datetime64, or a sequence of time objects"
    if isinstance(times, str) or not (isinstance(times, Sequence) or hasattr(times, "__array__")):
        raise TypeError(f"{wanted}, not {type(times).__name__}")
    if isinstance(times, Sequence) and not _are_numbers(times):
        times = _nanoseconds(times, wanted)
    try:
        array = _as_array(times)
    except OverflowError as error:
        raise ValueError(f"{wanted} that fit into 64 bits: {error}") from None
    mask = mask_of(times)
    if mask is not None and mask.any():
        raise ValueError(f"{wanted}; some are masked")
    if array.size == 0 and not isinstance(times, np.ndarray):
        array = array.astype(np.int64)
    if array.ndim != 1:
        raise ValueError(f"{wanted}; the shape is {array.shape}")
    if array.dtype == object:
        array = np.array(_nanoseconds(array, wanted), dtype=np.int64)
    if array.dtype.kind == "M":
        return _since_1970(array)
    if array.dtype.kind not in "iu":
        seconds = ": multiply seconds by 1e9, and round them to int64" if array.dtype.kind == "f" else ""
        raise TypeError(f"{wanted}, not of dtype {array.dtype}{seconds}")
    if array.dtype.kind == "u" and array.size and int(array.max()) > np.iinfo(np.int64).max:
        raise ValueError(f"{wanted} that fit into 64 bits; the largest is {array.max()}")
    return np.ascontiguousarray(array, dtype=np.int64)


def _are_numbers(times: Sequence[Any]) -> bool:
    """Whether all are numbers, or all datetime64: beside datetime64, NumPy takes ints to be of its unit."""
    import numpy as np

    classes = set(map(type, times))
    numbers = bool not in classes and all(issubclass(each, (int, float, np.number)) for each in classes)
    return numbers or classes == {np.datetime64}


def _as_array(times: Any) -> np.ndarray:
    import numpy as np

    # Times of pandas that have a time zone become objects, unless a dtype is asked for: then they are UTC.
    unit = getattr(getattr(times, "dtype", None), "unit", None)
    return np.asarray(times, dtype=None if unit is None else f"datetime64[{unit}]")


def _since_1970(times: np.ndarray) -> np.ndarray:
    """The nanoseconds of datetime64 of any unit."""
    import numpy as np

    try:
        exact = times.astype("datetime64[ns]")
        if (exact.astype(times.dtype) == times).all():  # NaT differs from itself
            return np.ascontiguousarray(exact).view(np.int64)
    except OverflowError:  # NumPy before 2.5 wraps around instead
        pass
    i = next(i for i, time in enumerate(times) if not _is_exact(time))
    raise ValueError(f"times[{i}] is {times[i]}: no whole number of nanoseconds that fits into 64 bits")


def _is_exact(time: np.datetime64) -> bool:
    try:
        time_ns(time, "time")
    except (OverflowError, ValueError):
        return False
    return True


def _nanoseconds(times: Iterable[Any], wanted: str) -> list[int]:
    try:
        return [time_ns(time, f"times[{i}]") for i, time in enumerate(times)]
    except TypeError as error:
        raise TypeError(f"{wanted}: {error}") from None
    except OverflowError as error:
        raise ValueError(f"{wanted} that fit into 64 bits: {error}") from None


def as_points(points: Any) -> tuple[np.ndarray, np.dtype]:
    """Points as contiguous float64 rows of shape (N, 3), and the dtype to give back: float64 of integers."""
    import numpy as np

    if isinstance(points, str):
        raise TypeError(
            "points must be an array of shape (N, 3), not str: the frames follow points and times"
        )
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points must have shape (N, 3); the shape is {array.shape}")
    if array.dtype.kind in "iu":
        array = array.astype(np.float64)
    if array.dtype not in (np.float32, np.float64):
        raise TypeError(f"points must be float32, float64 or integers, not {array.dtype}")
    return np.ascontiguousarray(array, dtype=np.float64), array.dtype
