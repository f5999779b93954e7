"""Owns how text that anybody may have sent is shown to people."""


def printable(text: str) -> str:
    r"""
    The text with every character that does not print as a backslash escape: ``\x1b``, ``\n``, ``\u202e``.

    Nothing else changes: letters of every script stay as they are. The escapes are Python's and YAML's.
    """
    if text.isprintable():
        return text
    # repr() escapes just these, without a loop of Python; and backslashes and, where both kinds of quotes
    # are there, single quotes, which are given back. What it returns holds no NUL.
    escaped = repr(text + '"')[1:-2]
    return escaped.replace("\\\\", "\0").replace("\\'", "'").replace("\0", "\\")
