"""Owns the limits of a buffer, so that no sender can fill the memory: defaults, and what sets others."""

import os

DEFAULTS = {"max_frames": 1_000_000, "max_bytes": 1 << 30, "max_waiters": 100_000}


def limit(name: str, given: int | None) -> int:
    """
    Decide one limit: the argument, else the environment variable, else the default.

    :param name: of the argument, a key of DEFAULTS; the variable of ``max_frames`` is
        ``TF2_ROS_CYTHON_MAX_FRAMES``.
    :param given: the argument; None: not given. Frames or waiters are counted, memory is in bytes.
    :raises TypeError: the argument is no int.
    :raises ValueError: the limit is not above 0, it does not fit into the C type that holds it, or the
        variable is no whole number.
    """
    source = name
    if given is None:
        source = f"TF2_ROS_CYTHON_{name.upper()}"
        text = os.environ.get(source, "")
        if not text:
            return DEFAULTS[name]
        if not text.isdecimal():
            raise ValueError(f"{source} must be a whole number, it is {text!r}")
        given = int(text)
    if isinstance(given, bool) or not isinstance(given, int):
        raise TypeError(f"{source} must be an int, not {type(given).__name__}")
    if not 0 < given < 1 << 31 and not (name == "max_bytes" and 0 < given < 1 << 63):
        raise ValueError(f"{source} must be above 0 and fit into a C integer, it is {given}")
    return given
