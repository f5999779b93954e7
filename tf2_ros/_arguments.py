# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Refuse arguments that cannot work where they are given, not where they are first used; read some kinds."""

from typing import Any

from tf2_py._internal import FOR_EVER_NS, duration_ns


def require_callable(method: str, callback: object) -> None:
    """Raise a TypeError if what a method is to call cannot be called, or would have to be awaited."""
    import inspect  # here, because importing it takes longer than all else in this module

    if not callable(callback):
        raise TypeError(f"{method}: expected a function, got {kind_of(callback)}")
    if inspect.iscoroutinefunction(callback) or inspect.iscoroutinefunction(type(callback).__call__):
        raise TypeError(
            f"{method}: expected an ordinary function, got an async one, which nothing would await: have the "
            "function create a task, or use async for"
        )


def optional_timeout_ns(timeout: Any, argument: str = "timeout") -> int | None:
    """The nanoseconds of a timeout; None, for no end, if it is None or at least FOR_EVER_NS."""
    nanoseconds = FOR_EVER_NS if timeout is None else duration_ns(timeout, argument)
    return None if nanoseconds == FOR_EVER_NS else nanoseconds


def kind_of(value: Any) -> str:
    """The name of a value's class; for a class, which may have been passed for an object, its own name."""
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__
