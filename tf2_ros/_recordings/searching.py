"""Owns which recordings are meant by a folder, a pattern, or a list."""

import glob
import os
from collections.abc import Iterable, Iterator
from os import PathLike
from typing import TypeAlias

from tf2_py._internal import printable
from tf2_ros._recordings.reading import MAGICS

__all__ = ["Recordings", "find_recordings"]

Recordings: TypeAlias = "str | PathLike[str] | Iterable[str | PathLike[str]]"

METADATA = "metadata.yaml"
SUFFIXES = tuple(MAGICS)


def find_recordings(recordings: Recordings) -> list[str]:
    """
    The recordings that are meant, each once, as absolute paths without symbolic links.

    :param recordings: a folder, which is searched with all folders in it; a pattern, such as
        ``"runs/**/*.mcap"``; a recording; a text file with one path in a line, relative to the folder of that
        file (empty lines and those that begin with ``#`` do not count); or paths of recordings.
        Paths in a list, and those of an iterable, need not exist.
    :raises FileNotFoundError: there is no such file, or no recording.
    :raises ValueError: a file is neither a recording nor a list.
    """
    if isinstance(recordings, str | PathLike):
        found = list(_meant_by(os.fspath(recordings)))
        if not found:
            raise FileNotFoundError(f"there is no recording in {printable(os.fspath(recordings))}")
    else:
        found = [os.fspath(path) for path in recordings]
        if not found:
            raise FileNotFoundError("recordings is empty")
    return list(dict.fromkeys(map(os.path.realpath, found)))


def _meant_by(path: str) -> Iterator[str]:
    if os.path.isdir(path):
        yield from _in_folder(path)
    elif os.path.exists(path):
        yield from [path] if path.endswith(SUFFIXES) else _listed(path)
    elif glob.has_magic(path):
        for match in sorted(glob.glob(path, recursive=True)):
            yield from _matched(match)
    else:
        raise FileNotFoundError(f"there is no {printable(path)}")


def _in_folder(path: str) -> Iterator[str]:
    if _is_rosbag2(path):
        yield path
        return
    for folder, inside, files in os.walk(path):
        bags = [name for name in sorted(inside) if _is_rosbag2(os.path.join(folder, name))]
        inside[:] = sorted(set(inside) - set(bags))
        yield from (os.path.join(folder, name) for name in bags)
        yield from (os.path.join(folder, name) for name in sorted(files) if _is_recording(name))


def _matched(path: str) -> Iterator[str]:
    folder = os.path.dirname(os.path.abspath(path))
    if os.path.isdir(path):
        yield from _in_folder(path)
    elif _is_rosbag2(folder):
        yield folder  # a part of it lacks what the other parts hold
    elif _is_recording(os.path.basename(path)):
        yield path


def _listed(path: str) -> Iterator[str]:
    folder = os.path.dirname(os.path.abspath(path))
    try:
        with open(path, encoding="utf-8", errors="strict") as file:
            lines = [line.strip() for line in file]
    except UnicodeDecodeError:
        raise ValueError(
            f"{printable(path)} is neither a recording, which ends in {', '.join(SUFFIXES)},"
            " nor a list of paths"
        ) from None
    return (os.path.join(folder, line) for line in lines if line and not line.startswith("#"))


def _is_rosbag2(folder: str) -> bool:
    # Others have files of this name, too: its first line tells them apart.
    path = os.path.join(folder, METADATA)
    if not os.path.isfile(path):
        return False
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return "rosbag2_bagfile_information" in file.read(4096)
    except OSError:
        return False


def _is_recording(name: str) -> bool:
    return name.endswith(SUFFIXES) and not name.startswith(".")
