"""Owns the names of shared buffers, and which one the environment wants."""

import os
import re
from collections.abc import Mapping
from pathlib import Path

__all__ = ["AUTO", "SharedBufferError", "VARIABLE", "buffer_name", "segment_path", "wanted_name"]

VARIABLE = "TF2_SHARED_BUFFER"
AUTO = "auto"  # the name that belongs to the ROS domain

FOLDER = Path("/dev/shm")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


class SharedBufferError(RuntimeError):
    """
    A buffer cannot be shared, or not be attached; the text says why.

    >>> from tf2_ros import Buffer, SharedBufferError
    >>> try:
    ...     Buffer(attach="nobody")
    ... except SharedBufferError as error:
    ...     print(error)
    no process of this user shares a buffer 'nobody'
    """


def buffer_name(name: str, domain: int | None = None) -> str:
    """
    Get the name of a shared buffer.

    :param name: letters, digits, ``.``, ``_`` and ``-``, at most 100; or ``auto``.
    :param domain: for ``auto``, the ROS domain. None: that of the environment.
    :raises TypeError: ``name`` is no str.
    :raises ValueError: it is no name.
    """
    if not isinstance(name, str):
        raise TypeError(f"the name of a shared buffer must be a str, not {type(name).__name__}")
    if not _NAME.fullmatch(name):
        raise ValueError(
            f"{name!r} is no name of a shared buffer: letters, digits, '.', '_' and '-', at most 100, "
            "beginning with a letter or digit"
        )
    if name != AUTO:
        return name
    return f"domain-{_domain_of(os.environ) if domain is None else domain}"


def _domain_of(environ: Mapping[str, str]) -> int:
    """The ROS domain, as ROS reads its number: as C does."""
    text = environ.get("ROS_DOMAIN_ID", "").strip()
    base = 16 if text.lower().startswith("0x") else 8 if text.startswith("0") else 10
    try:
        return int(text, base) if text else 0
    except ValueError:
        raise ValueError(f"ROS_DOMAIN_ID is no number: {text!r}") from None


def wanted_name(domain: int, environ: Mapping[str, str] = os.environ) -> str | None:
    """The name that the environment asks programs of this ROS domain to attach to, or None."""
    name = environ.get(VARIABLE)
    return buffer_name(name, domain) if name else None


def segment_path(name: str) -> Path:
    """The file of the shared buffer of this name, of this user."""
    return FOLDER / f"tf2-ros-cython-{os.geteuid()}-{name}"
