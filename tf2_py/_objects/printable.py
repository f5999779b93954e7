"""Owns how text from messages, which may hold anything, is shown in logs, errors and reprs."""


def printable(text: str) -> str:
    r"""
    The text with every character that does not print as a backslash escape: ``\x1b``, ``\n``, ``\u202e``.

    Nothing else changes: letters of every script stay as they are. The escapes are Python's and YAML's.
    """
    if text.isprintable():
        return text
    # repr() escapes these characters without a Python loop. It also escapes backslashes and, in a text with
    # both kinds of quotes, single quotes: these two are undone. What it returns holds no NUL.
    escaped = repr(text + '"')[1:-2]
    return escaped.replace("\\\\", "\0").replace("\\'", "'").replace("\0", "\\")


def class_name(kind: type) -> str:
    """A class by the names of its package and its own, as ``tf2_ros.Buffer``."""
    return f"{kind.__module__.partition('.')[0]}.{kind.__qualname__}"


def three_digits(number: float) -> str:
    """A number with three significant digits, or all those before the point; never in powers of ten."""
    return f"{number:.0f}" if abs(number) >= 100.0 else f"{number:.3g}"


def counted(number: int, what: str) -> str:
    """``1 frame``, ``2 frames``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
