# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuzz recordings of all formats: damage is a BagError."""

import shutil
import sqlite3
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from reliability.fuzz.buffer_checks import Fault
from tf2_ros_tools.bag import BagError, load, stamps, transforms

MOST_BYTES = 12000
_folder = tempfile.TemporaryDirectory(prefix="tf2-fuzz-", dir="/dev/shm")
_FILES = {0: "run.mcap", 1: "run.db3", 2: "run.bag"}
# Of a folder: its metadata and one file, by the first byte, the size of the metadata in two more.
_FOLDERS = {3: "run.mcap", 4: "run.db3", 5: "run.mcap.zstd", 6: "run.db3.zstd"}
_KINDS = len(_FILES) + len(_FOLDERS)
_TOOLS = Path(__file__).resolve().parents[2]


def run(data: bytes) -> None:
    """Read one recording in one of the ways that there are, which the first byte selects."""
    root = Path(_folder.name)
    first = data[0] if data else 0
    kind, way = first % _KINDS, first // _KINDS
    path = _written(kind, data[1:], root)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # Such as of fewer messages than metadata.yaml counts.
            warnings.simplefilter("ignore", UserWarning)
            _WAYS[way % len(_WAYS)](path)
    except BagError:
        pass
    finally:
        for one in root.iterdir():
            if one.is_dir():
                shutil.rmtree(one)
            else:
                one.unlink()


def _written(kind: int, data: bytes, root: Path) -> Path:
    if kind in _FILES:
        path = root / _FILES[kind]
        path.write_bytes(data)
        return path
    path = root / "run"
    path.mkdir()
    size = int.from_bytes(data[:2], "little")
    (path / "metadata.yaml").write_bytes(data[2 : 2 + size])
    (path / _FOLDERS[kind]).write_bytes(data[2 + size :])
    return path


def _load(path: Path) -> None:
    load(path, progress=False)._self_check()


def _transforms(path: Path) -> None:
    for log_ns, static, transform in transforms(path):
        if type(log_ns) is not int or type(static) is not bool:
            raise Fault(f"{log_ns!r}, {static!r}, {transform!r}")


def _stamps(path: Path) -> None:
    stamps(path, "/scan")


_WAYS = [_load, _transforms, _stamps]


def seeds() -> Iterator[bytes]:
    """Small recordings of all formats, to be read in all ways."""
    for number, (kind, data) in enumerate(_recordings()):
        for way in range(len(_WAYS)):
            if way == 0 or (number + way) % 4 == 0:
                yield bytes([kind + _KINDS * way]) + data


def _recordings() -> Iterator[tuple[int, bytes]]:
    # As `_written` takes them.
    sys.path[:0] = [str(_TOOLS / "tests" / "support"), str(_TOOLS.parent / "tests" / "support")]
    import making_bags

    messages = making_bags.drive(3)
    messages.append(making_bags.scan(messages[-1].log_ns, messages[-1].log_ns))
    for name, write in making_bags.FORMATS.items():
        if name.startswith("split"):
            continue
        some = messages if "ros1" not in name else messages[:-1]
        with tempfile.TemporaryDirectory() as folder:
            path = write(Path(folder), some)
            for database in [path, *path.glob("*")]:
                if database.suffix == ".db3":
                    _shrink(database)
            if path.suffix == ".zstd":
                continue  # the folders have the same files
            if path.is_file():
                kind = next(number for number, file in _FILES.items() if file.endswith(path.suffix))
                yield kind, path.read_bytes()
                continue
            (file,) = (one for one in path.iterdir() if one.name != "metadata.yaml")
            new_name = "run" + "".join(file.suffixes)
            metadata = (path / "metadata.yaml").read_bytes().replace(file.name.encode(), new_name.encode())
            kind = next(number for number, one in _FOLDERS.items() if one == new_name)
            yield kind, len(metadata).to_bytes(2, "little") + metadata + file.read_bytes()


def _shrink(database: Path) -> None:
    with closing(sqlite3.connect(database)) as connection:
        connection.executescript("PRAGMA journal_mode = DELETE; PRAGMA page_size = 512; VACUUM")
