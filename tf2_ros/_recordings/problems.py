"""Owns the errors about recordings, which name what is wrong with one."""

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from tf2_py._internal import printable

__all__ = ["BagError", "BagWarning", "broken", "explained", "listed", "needing", "needs"]

# For the argument of `load`, and for the option of tf2_bag.
IN_PART = "the option partial reads what can be read of it"
# What rosbags says of files without their end, which does not tell how that comes about.
ENDLESS = ("File end magic is invalid", "Bag is not indexed", "Bag index looks damaged")


class BagError(ValueError):
    """
    A recording cannot be read; the text names the file, the topic, and what was found.

    ``found`` is the text without the advice to read the recording in part.
    """

    def __init__(self, found: str, *, readable_in_part: bool = False) -> None:
        super().__init__(f"{found}; {IN_PART}" if readable_in_part else found)
        self.found = found
        self.readable_in_part = readable_in_part


class BagWarning(UserWarning):
    """A recording was read, but not all of it."""


def explained(error: Exception, path: str, where: str = "") -> Exception:
    """
    The BagError for whatever is raised about the bytes of a file; the error itself, if it is about something
    else. The libraries have errors of their own for some damages only.

    :param where: in the file.
    """
    if isinstance(error, (BagError, ImportError)):
        return error
    # bz2 has one without a number about its data; a spoiled length gives a place where no file can be read.
    if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
        return error
    return broken(error, path, where)


def broken(error: Exception, path: str, where: str = "") -> BagError:
    """The BagError for what is raised about the bytes of a file; ``where`` is a place in it."""
    found = str(error).rstrip(".")
    if isinstance(error, MemoryError):
        found = "a part of it would need more memory than there is"
    if found.startswith(ENDLESS):
        found += " (its recorder was not ended, or its end was cut off)"
    text = f"{printable(path)} is broken{', ' * bool(where)}{where}: {printable(found or repr(error))}"
    return BagError(text, readable_in_part=True)


def listed(names: Iterable[str]) -> str:
    """The names in one line, each once; ``none`` if there is none."""
    return ", ".join(printable(name) for name in sorted(set(names))) or "none"


def needs(library: str, extra: str) -> ModuleNotFoundError:
    """The error for a library that is not installed."""
    return ModuleNotFoundError(
        f"{library} is not installed: pip install 'tf2-ros-cython[{extra}]'", name=library
    )


@contextmanager
def needing(library: str, extra: str) -> Iterator[None]:
    """Around an import: where it fails for want of the library, the error says what to install."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] != library:
            raise
        raise needs(library, extra) from missing
