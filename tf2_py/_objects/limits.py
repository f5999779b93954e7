"""Owns how much a buffer may hold: more than robots need, less than a hostile sender would send."""

import os

DEFAULTS = {"max_frames": 1_000_000, "max_bytes": 1 << 30, "max_waiters": 100_000}


def limit(name: str, given: int | None) -> int:
    """A limit: as given, or as in the environment (``TF2_ROS_CYTHON_MAX_FRAMES`` ...), or the default."""
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
