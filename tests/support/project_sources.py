# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read the project's sources: modules, their imports and cimports, and the names they define."""

import re
import sys
from collections.abc import Container, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from paths import ROOT

from tf2_ros_cython import _installation

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = (*_installation.PACKAGES, "tf2_ros_cython")
OTHERS = ("build_backend", "bench", "tests", "examples")
ALL = (*PACKAGES, *OTHERS)
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
_STATEMENT = re.compile(
    r"^[ \t]*(?:from[ \t]+(?P<origin>[.\w]+)[ \t]+)?c?import\b[ \t]*(?P<names>\([^)]*\)|[^\n]*)",
    re.MULTILINE,
)


class Import(NamedTuple):
    """One imported module: ``from a import b`` imports ``a.b`` where that is a module, otherwise ``a``."""

    module: str
    line: int


@cache
def modules(root: Path = ROOT, packages: tuple[str, ...] = ALL) -> dict[str, tuple[Path, ...]]:
    """The modules and chapters of packages by their dotted names; each may have several files."""
    found: dict[str, list[Path]] = {}
    for package in packages:
        for suffix in ("py", "pyx", "pxd", "pxi", "pyi"):
            for path in sorted((root / package).rglob(f"*.{suffix}")):
                if path.name not in GENERATED:
                    name = ".".join(path.relative_to(root).with_suffix("").parts)
                    if suffix == "pxi":
                        name = name.removesuffix("_header")
                    found.setdefault(name.removesuffix(".__init__"), []).append(path)
    return {name: tuple(paths) for name, paths in found.items()}


def imports(path: Path, root: Path = ROOT, packages: tuple[str, ...] = ALL) -> list[Import]:
    """What a file of these packages imports and cimports, anywhere; relative names are made absolute."""
    parent = list(path.relative_to(root).parent.parts)
    code = code_of(path.read_text(encoding="utf-8"))
    found = []
    for one in _STATEMENT.finditer(code):
        names = [part.split()[0] for part in one["names"].strip("() \t\n").split(",") if part.split()]
        imported = (
            names
            if one["origin"] is None
            else _absolute(one["origin"], names, parent, modules(root, packages))
        )
        line = 1 + code.count("\n", 0, one.start())
        found += [Import(module, line) for module in imported]
    return found


def code_of(text: str) -> str:
    """The same lines with empty strings and without comments."""
    return _TEXT.sub(lambda found: '""' + "\n" * found[0].count("\n") if found[0][0] != "#" else "", text)


def _absolute(name: str, names: list[str], parent: list[str], known: Container[str]) -> Iterator[str]:
    level = len(name) - len(name.lstrip("."))
    if level:
        kept = parent[: len(parent) - level + 1]
        name = ".".join([*kept, *filter(None, [name.lstrip(".")])])
    submodules = [f"{name}.{one}" for one in names if f"{name}.{one}" in known]
    yield from submodules
    if len(submodules) < len(names) or not names:
        yield name


def _included(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    return re.findall(r'^include "(.+?)(?:_header)?\.pxi"$', text, re.MULTILINE)


def chapters(module: str) -> list[str]:
    """The chapters that a Cython module includes, in that order: first those that have only a header."""
    folder, _, name = module.rpartition(".")
    path = ROOT.joinpath(*folder.split("."), f"{name}.pyx")
    included = _included(path)
    headers = _included(path.with_suffix(".pxd")) if path.with_suffix(".pxd").exists() else []
    included = [one for one in headers if one not in included] + included
    return [f"{folder}.{chapter.replace('/', '.')}" for chapter in included]


_DEFINED = re.compile(
    r"^(?:cdef|cpdef|ctypedef|def|class)\b(?! extern| enum:)"
    r'(?:[^\n(=:"]*[ *])?(?P<name>\w+)(?=\(|[ \t]*[=:\n"])'
    r"|^(?P<constant>\w+) = ",
    re.MULTILINE,
)
_BLOCK = re.compile(r"^cdef (?:extern|enum)\b[^\n]*:[^\n]*\n((?:(?:    [^\n]*)?\n)+)", re.MULTILINE)
_MEMBER = re.compile(
    r'^    (?! )(?:[^\n(="]*[ *])?(?P<name>\w+)[ \t]*(?:\[\w*\])?(?=[(=\n":]| "|$)', re.MULTILINE
)


def defined(code: str) -> set[str]:
    """The names that Cython code defines or declares for the whole module: see :func:`code_of`."""
    found = {one["name"] or one["constant"] for one in _DEFINED.finditer(code)}
    for block in _BLOCK.finditer(code):
        found |= {one["name"] for one in _MEMBER.finditer(block[1])}
    return found


@cache
def words_of_sources(root: Path = ROOT, packages: tuple[str, ...] = PACKAGES) -> frozenset[str]:
    """Every word that is in the packages' code, without comments and docstrings."""
    files = (path for paths in modules(root, packages).values() for path in paths)
    text = "\n".join(path.read_text(encoding="utf-8") for path in files)
    return frozenset(re.findall(r"\w+", re.sub(r'""".*?"""|#[^\n]*', "", text, flags=re.DOTALL)))
