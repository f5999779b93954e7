# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Say how to install a library that only some commands need."""

from importlib.util import find_spec


class MissingLibraryError(ModuleNotFoundError):
    """A library is not installed; the text says how to install it."""


def require(library: str, extra: str, advice: str = "") -> None:
    """
    Raise a MissingLibraryError unless a library is installed.

    :param library: the name under which it is imported.
    :param extra: of tf2-ros-tools; installs it.
    :param advice: the end of the text, for systems where this does not install it.
    """
    if find_spec(library) is None:
        text = f"{library} is not installed: pip install 'tf2-ros-tools[{extra}]'{advice}"
        raise MissingLibraryError(text, name=library)
