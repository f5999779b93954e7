# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Show names that anybody may have sent, and numbers with their units."""

__all__ = ["counted", "printable"]


def printable(text: str) -> str:
    r"""
    Escape every character that does not print, as in ``\x1b``, ``\n``, ``\u202e``.

    Frames have any name that a publisher gives them. One with such characters could steer a terminal, or
    begin another line of a log. Letters of every script stay as they are. The escapes are valid in Python and
    in YAML.
    """
    if text.isprintable():
        return text
    # repr() escapes these characters without a Python loop. It also escapes backslashes and, in a text with
    # both kinds of quotes, single quotes; both are undone here. Its result contains no NUL.
    escaped = repr(text + '"')[1:-2]
    return escaped.replace("\\\\", "\0").replace("\\'", "'").replace("\0", "\\")


def counted(number: float, what: str) -> str:
    """A number and its unit: ``1 frame``, ``2 frames``, ``2.5 seconds``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
