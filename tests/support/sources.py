"""Read the project's sources: modules, their imports and cimports, and the names they define."""

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from paths import ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = ("tf2_py", "tf2_ros", "tf2_geometry_msgs", "tf2_sensor_msgs", "tf2_ros_tools", "tf2_ros_cython")
OTHERS = ("build_backend", "bench", "tests", "examples")
GENERATED = ("_built.py",)

# Docstrings and other strings, then comments: whatever stands in them is no statement.
_TEXT = re.compile(
    r'"""(?:\\.|[^\\])*?"""'
    r"|'''(?:\\.|[^\\])*?'''"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'(?:\\.|[^'\\\n])*'"
    r"|#[^\n]*",
    re.DOTALL,
)
_FROM = re.compile(
    r"^[ \t]*from[ \t]+(?P<module>[.\w]+)[ \t]+(?P<kind>c?import)[ \t\f]*(?P<names>\([^)]*\)|[^\n]*)",
    re.MULTILINE,
)
_PLAIN = re.compile(r"^[ \t]*(?P<kind>c?import)[ \t]+(?P<names>[^\n]+)", re.MULTILINE)


@dataclass(frozen=True)
class Import:
    """One imported module: ``from a import b`` imports ``a.b`` where that is a module, otherwise ``a``."""

    module: str
    line: int
    is_cimport: bool


@cache
def modules() -> dict[str, tuple[Path, ...]]:
    """The project's modules by their dotted names; a Cython module has up to three files."""
    found: dict[str, list[Path]] = {}
    for package in (*PACKAGES, *OTHERS):
        for suffix in ("py", "pyx", "pxd", "pyi"):
            for path in sorted((ROOT / package).rglob(f"*.{suffix}")):
                if path.name not in GENERATED:
                    parts = path.relative_to(ROOT).with_suffix("").parts
                    found.setdefault(".".join(parts).removesuffix(".__init__"), []).append(path)
    return {name: tuple(paths) for name, paths in found.items()}


def imports(path: Path) -> list[Import]:
    """What a file imports and cimports, anywhere in it; relative names are made absolute."""
    parent = list(path.relative_to(ROOT).parent.parts)
    return [
        Import(module, line, is_cimport)
        for name, names, line, is_cimport in statements(path.read_text(encoding="utf-8"))
        for module in _absolute(name, names, parent)
    ]


def statements(text: str) -> Iterator[tuple[str, tuple[str, ...], int, bool]]:
    """The import and cimport statements: module, names taken from it, line, whether a cimport."""
    code = code_of(text).replace("\\\n", "\f")
    for pattern in (_FROM, _PLAIN):
        for found in pattern.finditer(code):
            line = 1 + code.count("\n", 0, found.start()) + code.count("\f", 0, found.start())
            is_cimport, names = found["kind"] == "cimport", _names(found["names"])
            if pattern is _FROM:
                yield found["module"], names, line, is_cimport
            else:
                yield from ((name, (), line, is_cimport) for name in names)


def code_of(text: str) -> str:
    """The same lines with empty strings and without comments."""
    return _TEXT.sub(lambda found: '""' + "\n" * found[0].count("\n") if found[0][0] != "#" else "", text)


def _names(listed: str) -> tuple[str, ...]:
    parts = (part.split() for part in listed.strip("() \t\n\f").split(","))
    return tuple(words[0] for words in parts if words)


def _absolute(name: str, names: tuple[str, ...], parent: list[str]) -> Iterator[str]:
    level = len(name) - len(name.lstrip("."))
    if level:
        kept = parent[: len(parent) - level + 1]
        name = ".".join([*kept, *filter(None, [name.lstrip(".")])])
    submodules = [f"{name}.{one}" for one in names if f"{name}.{one}" in modules()]
    yield from submodules
    if len(submodules) < len(names) or not names:
        yield name


@cache
def words_of_sources() -> frozenset[str]:
    """Every word that is in the packages' code, without comments and docstrings."""
    files = (path for name, paths in modules().items() if name.startswith(PACKAGES) for path in paths)
    text = "\n".join(path.read_text(encoding="utf-8") for path in files)
    return frozenset(re.findall(r"\w+", re.sub(r'""".*?"""|#[^\n]*', "", text, flags=re.DOTALL)))
