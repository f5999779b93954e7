"""Format texts and angles, write files, and find libraries, in the same way for all tools."""

import json
import os
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from importlib.util import find_spec
from typing import Any

from tf2_py.files import whole_file
from tf2_py.printable import printable

MOST_NAMES = 5  # in a list


def show(*lines: str) -> None:
    """Print lines, without characters that could steer a terminal or begin another line."""
    print("\n".join(map(printable, lines)))


def show_json(content: Any) -> None:
    """Print an object as one line of JSON."""
    # json leaves the delete character as it is, whose usual escape is not JSON.
    print(json.dumps(content).replace("\x7f", r"\u007f"))


def counted(number: float, what: str) -> str:
    """Format a number and its unit: ``1 frame``, ``2 frames``, ``2.5 seconds``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def three_digits(number: float) -> str:
    """Format a number with three significant digits, or from 100 on as a whole number."""
    return f"{number:.0f}" if abs(number) >= 100.0 else f"{number:.3g}"


def first_names(names: Sequence[str]) -> str:
    """Format the first five names: ``a, b, c, d, e and 3 more``."""
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"{', '.join(map(printable, names[:MOST_NAMES]))}{more}"


def not_known(name: str, known: Collection[str]) -> str:
    """Say that a frame is unknown, and suggest similar names."""
    near = get_close_matches(name, known, n=3)
    advice = f"; did you mean {' or '.join(near)}?" if near else ""
    return printable(f"{name} is not known{advice}")


def rpy_from_matrices(matrices: Any) -> Any:
    """
    Get the roll, pitch and yaw of rotations: turns about the fixed axes x, y and z, in this order.

    :param matrices: an array of matrices, or one matrix, with the rotation in the upper left 3 x 3 numbers.
    :return: an array of shape (..., 3), in radians; the pitch is from -pi/2 to pi/2. At these two limits,
        where roll and yaw turn about the same axis, yaw is 0.
    """
    import numpy as np

    m = np.asarray(matrices)
    pole = np.abs(m[..., 2, 0]) >= 1.0
    roll = np.where(pole, np.arctan2(-m[..., 1, 2], m[..., 1, 1]), np.arctan2(m[..., 2, 1], m[..., 2, 2]))
    pitch = -np.arcsin(np.clip(m[..., 2, 0], -1.0, 1.0))
    yaw = np.where(pole, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    return np.stack([roll, pitch, yaw], axis=-1)


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


def write_whole(path: str | os.PathLike[str], data: bytes | memoryview) -> None:
    """
    Replace a file in one step, so that a reader finds either the old contents or all of the new ones.

    :raises OSError: the file cannot be written; its old contents remain.
    """
    with whole_file(path) as file:
        file.write(data)
