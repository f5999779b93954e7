"""Owns the program that writes types of ROS's messages for type checkers, from the installed messages."""

import argparse
import importlib
import importlib.util
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tf2_ros._whole_files import write_whole

__all__ = ["main"]

# Those that the signatures of this project name.
PACKAGES = ("geometry_msgs", "nav_msgs", "sensor_msgs", "tf2_msgs")

# The names that fields could hide are used with an underscore, or from `builtins`.
HEADER = '''"""Types of the messages that were installed when tf2_ros.cli.message_stubs wrote this."""

import array as _array
import builtins
from collections.abc import Iterable as _Iterable, Sequence as _Sequence
from typing import Any as _Any, Final as _Final

import numpy as _np
import numpy.typing as _npt
'''

SCALARS = {"boolean": "bool", "octet": "bytes", "string": "str", "wstring": "str", "float": "float"}
SCALARS |= {"double": "float"} | {f"{u}int{bits}": "int" for u in ("", "u") for bits in (8, 16, 32, 64)}
# ROS keeps sequences of these in an array.array, and arrays of fixed size in one of NumPy.
NUMBERS = {name for name, kind in SCALARS.items() if kind in ("float", "int")}
DTYPES = {"float": "float32", "double": "float64"}

# The interfaces that a package may have, and the messages of which each is made.
PARTS = {"msg": (), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
# What else a class has; rclpy's own signatures ask for it.
OTHERS = {"msg": (), "srv": ("Event",), "action": ("Impl",)}

_SEQUENCE = re.compile(r"sequence<(?P<item>.+?)(, \d+)?>")
_ARRAY = re.compile(r"(?P<item>.+)\[\d+\]")


def main(args: list[str] | None = None) -> int:
    """
    Write the stubs of message packages, and of those whose messages these contain.

    :param args: of the command line, without the program's name. None: those of the process.
    :return: the exit status: 1, and nothing is written, where a package has no messages or is not installed;
        1, too, where a file cannot be written.
    """
    parser = argparse.ArgumentParser(
        prog="python -m tf2_ros.cli.message_stubs",
        description="Write the types of ROS's messages for mypy and pyright.",
    )
    parser.add_argument("folder", type=Path, help="where to write them; pyright looks into typings by itself")
    # With a default argparse does not call them required.
    parser.add_argument(
        "packages", nargs="*", default=[], help=f"message packages; default: {' '.join(PACKAGES)}"
    )
    chosen = parser.parse_args(args)
    packages = chosen.packages or [name for name in PACKAGES if importlib.util.find_spec(name)]
    without = [name for name in packages if not _has_messages(name)]
    if without:
        print(f"no messages are installed of {', '.join(without)}", file=sys.stderr)
        return 1
    for package in _with_those_used(packages):
        if _is_typed(package):
            print(f"{package} has types of its own")
            continue
        try:
            _write(package, chosen.folder)
        except OSError as failure:
            print(f"cannot write {failure.filename}: {failure.strerror}", file=sys.stderr)
            return 1
        print(f"wrote {chosen.folder / package}")
    return 0


def _has_messages(package: str) -> bool:
    return importlib.util.find_spec(package) is not None and any(_interfaces(package, kind) for kind in PARTS)


def _is_typed(package: str) -> bool:
    return any((Path(folder) / "py.typed").exists() for folder in importlib.import_module(package).__path__)


def _with_those_used(packages: list[str]) -> list[str]:
    known = list(dict.fromkeys(packages))
    for package in known:  # which grows meanwhile
        known += [used for used in _packages_used(package) if used not in known]
    return known


def _packages_used(package: str) -> list[str]:
    texts = [
        text
        for kind in PARTS
        for cls in _interfaces(package, kind)
        for message in _messages(cls, kind).values()
        for text in message.get_fields_and_field_types().values()
    ]
    return list(dict.fromkeys(used for text in texts for used in re.findall(r"(\w+)/", text)))


def _interfaces(package: str, kind: str) -> list[type]:
    if importlib.util.find_spec(f"{package}.{kind}") is None:
        return []
    named = sorted(vars(importlib.import_module(f"{package}.{kind}")).items())
    # The parts of services are in the module, too.
    return [
        one for _, one in named if isinstance(one, type) and all(hasattr(one, part) for part in PARTS[kind])
    ]


def _messages(cls: type, kind: str) -> dict[str, Any]:
    return {part: getattr(cls, part) for part in PARTS[kind]} or {cls.__name__: cls}


def _write(package: str, folder: Path) -> None:
    (folder / package).mkdir(parents=True, exist_ok=True)
    write_whole(folder / package / "__init__.pyi", b"")
    imports = "".join(f"import {name}.msg as _{name}\n" for name in sorted(_packages_used(package)))
    for kind in PARTS:
        classes = _interfaces(package, kind)
        if classes:
            (folder / package / kind).mkdir(exist_ok=True)
            lines = [line for cls in classes for line in ("", *_class(cls, kind))]
            text = HEADER + imports + "\n".join(lines) + "\n"
            write_whole(folder / package / kind / "__init__.pyi", text.encode())


def _class(cls: type, kind: str) -> Iterator[str]:
    lines = [line for name, message in _messages(cls, kind).items() for line in _message(message, name)]
    if not PARTS[kind]:
        yield from lines
        return
    yield f"class {cls.__name__}:"
    yield from (f"    {line}" for line in lines)
    yield from (f"    {other}: _Any" for other in OTHERS[kind])


def _message(cls: Any, name: str) -> Iterator[str]:
    fields = {field: _types(text) for field, text in cls.get_fields_and_field_types().items()}
    arguments = [f"{field}: {taken} = ..." for field, (_, taken) in fields.items()]
    arguments.append("check_fields: builtins.bool = ...")
    yield f"class {name}:"
    # The class's constants, and the defaults of its fields; rosidl keeps them in its metaclass.
    for constant, value in type(cls).__prepare__(name, ()).items():
        known = type(value).__name__ in SCALARS.values()  # the default of an array is an array
        yield f"    {constant}: _Final[{f'builtins.{type(value).__name__}' if known else '_Any'}]"
    yield f"    def __init__(self, *, {', '.join(arguments)}) -> None: ..."
    yield "    @builtins.classmethod"
    yield "    def get_fields_and_field_types(cls) -> builtins.dict[builtins.str, builtins.str]: ..."
    for field, (given, taken) in fields.items():
        if given == taken:
            yield f"    {field}: {given}"
        else:
            yield "    @builtins.property"
            yield f"    def {field}(self) -> {given}: ..."
            yield f"    @{field}.setter"
            yield f"    def {field}(self, value: {taken}) -> None: ..."


def _types(text: str) -> tuple[str, str]:
    """The type that a field has when it is read, and the one that may be assigned to it."""
    sequence = _SEQUENCE.fullmatch(text)
    many = sequence or _ARRAY.fullmatch(text)
    if many is None:
        return _scalar(text), _scalar(text)
    name = many["item"]
    item = _scalar(name)
    if name not in NUMBERS:
        return f"builtins.list[{item}]", f"_Sequence[{item}]"
    if sequence is not None:
        return f"_array.array[{item}]", f"_Iterable[{item}]"
    return f"_npt.NDArray[_np.{DTYPES.get(name, name)}]", f"_Sequence[{item}] | _npt.NDArray[_Any]"


def _scalar(text: str) -> str:
    package, slash, name = text.partition("/")
    if slash:
        return f"_{package}.{name}"
    return f"builtins.{SCALARS[text.partition('<')[0]]}"  # a string may have a bound


if __name__ == "__main__":
    sys.exit(main())
