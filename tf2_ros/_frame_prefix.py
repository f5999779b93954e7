# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prefixes of frame names, and the frame to look up for a message, with a prefix before it."""

from typing import Any

from tf2_py import stored_name
from tf2_ros._arguments import kind_of
from tf2_ros._registration import UnstampedError, how_without_header


def valid_prefix(prefix: str) -> str:
    """The prefix; raises an error if no frame name can begin with it."""
    if not isinstance(prefix, str):
        raise TypeError(f"prefix: expected a str, got {type(prefix).__name__}")
    if "\0" in prefix:
        raise ValueError(f"prefix: expected a str without NUL, got {prefix!r}")
    return prefix


def with_prefix(prefix: str, name: str) -> str:
    """A frame name of a message with a prefix before it, for a transform; as `batch_prefix` in C."""
    return prefix + stored_name(name) if name not in ("", "/") else ""


def frame_of(header: Any, prefix: str) -> Any:
    """The frame to look up for a message: that of its header, with a prefix before it if there is one."""
    return stored_name(with_prefix(valid_prefix(prefix), header.frame_id)) if prefix else header.frame_id


def source_of(stamped: Any, prefix: str) -> tuple[Any, Any]:
    """The frame to look up for a message, as :func:`frame_of`, and its stamp."""
    try:
        header = stamped.header
    except AttributeError:
        text = f"object_stamped: expected an object with a header, got {kind_of(stamped)}"
        raise UnstampedError(f"{text}{how_without_header(type(stamped))}") from None
    return frame_of(header, prefix) if prefix else header.frame_id, header.stamp
