"""Say how to install a library that only some commands need."""

from importlib.util import find_spec


class MissingLibraryError(ModuleNotFoundError):
    """A library is not installed; the text says how to install it."""


def require(library: str, extra: str) -> None:
    """
    Raise a MissingLibraryError unless a library is installed.

    :param library: the name under which it is imported.
    :param extra: of tf2-ros-tools; installs it.
    """
    if find_spec(library) is None:
        text = f"{library} is not installed: pip install 'tf2-ros-tools[{extra}]'"
        raise MissingLibraryError(text, name=library)
