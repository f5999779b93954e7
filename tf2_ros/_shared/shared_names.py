"""Names of shared buffers, and the one that the environment names."""

import os
import re
import sys
from pathlib import Path
from typing import Any

from tf2_ros_cython._ros_presence import HAS_ROS, absence

VARIABLE = "TF2_SHARED_BUFFER"
AUTO = "auto"  # the name that belongs to the ROS domain

FOLDER = Path("/dev/shm")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


class SharedBufferError(RuntimeError):
    """
    A buffer cannot be shared or attached; the text says why.

    >>> from tf2_ros import Buffer, SharedBufferError
    >>> try:
    ...     Buffer(attach="nobody")
    ... except SharedBufferError as error:
    ...     print(error)
    no process of this user shares a buffer 'nobody': start one, such as tf2_shared_buffer --name nobody
    """


def require_support() -> None:
    """Raise an error where buffers cannot be shared."""
    if sys.platform != "linux":
        raise NotImplementedError("buffers can be shared only on Linux")
    if not HAS_ROS:
        raise absence("a shared buffer")


def buffer_name(name: str, node: Any = None) -> str:
    """
    Get the name of a shared buffer.

    :param name: letters, digits, ``.``, ``_`` and ``-``, at most 100; or ``auto``.
    :param node: whose ROS domain ``auto`` stands for. None: that of the environment.
    :raises TypeError: ``name`` is not a str.
    :raises ValueError: it is not a valid name.
    """
    if not isinstance(name, str):
        raise TypeError(f"the name of a shared buffer: expected a str, got {type(name).__name__}")
    if not _NAME.fullmatch(name):
        raise ValueError(
            "the name of a shared buffer: expected 1 to 100 letters, digits, '.', '_' or '-', of which the "
            f"first is a letter or digit, got {name!r}"
        )
    if name != AUTO:
        return name
    domain = os.environ.get("ROS_DOMAIN_ID") or "0" if node is None else node.context.get_domain_id()
    return f"domain-{int(domain)}"


def is_wanted() -> bool:
    """Whether the environment asks programs to attach to a shared buffer."""
    return bool(os.environ.get(VARIABLE)) and sys.platform == "linux"


def segment_path(name: str) -> Path:
    """The file of the shared buffer of this name, of this user."""
    return FOLDER / f"tf2-ros-cython-{os.geteuid()}-{name}"
