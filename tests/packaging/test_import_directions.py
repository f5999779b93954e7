# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The direction of imports: the table in docs/development/internals.md, and what the sources import."""

import re
import sys

import pytest
from paths import ROOT
from project_sources import PACKAGES, chapters, code_of, defined, imports, modules

INTERNALS = ROOT / "docs" / "development" / "internals.md"
HEADER = [
    "package",
    "contains",
    "imports",
    "third-party and ROS",
    "underscored modules open to others",
]
ANYTHING = ["anything"]
# What Cython brings: C's, POSIX's and Python's own declarations.
STANDARD = {"libc", "posix", "cpython", "cython", *sys.stdlib_module_names}


def read_table():
    """The rows of the table by their packages, each a list of the names in each of its columns."""
    lines = INTERNALS.read_text(encoding="utf-8").splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    rows = cells[cells.index(HEADER) + 2 :]
    rows = rows[: [len(row) == len(HEADER) for row in rows].index(False)]
    return {row[0].strip("`"): [re.findall(r"`([^`]+)`", cell) or [cell] for cell in row] for row in rows}


TABLE = read_table()
# The imports of each module, of all its files; those of the packages themselves are among them.
IMPORTS = {name: [one for path in paths for one in imports(path)] for name, paths in modules().items()}
OPEN = {f"{name}.{module}" for name, row in TABLE.items() for module in row[4]}


def package_of(module):
    """The package of the table that a module belongs to: the longest name that is a part of its own."""
    return max((name for name in TABLE if f"{module}.".startswith(f"{name}.")), key=len, default=None)


def top(module):
    return module.partition(".")[0]


def is_allowed(module, imported):
    """Whether the table allows an import."""
    package, other = package_of(module), package_of(imported)
    _, _, allowed, outside, _ = TABLE[package]
    if other is None:
        return outside == ANYTHING or top(imported) in {*STANDARD, *outside}
    if allowed == ANYTHING:
        return True
    is_private = top(imported) != top(module) and "._" in imported and imported not in OPEN
    return other in (package, *allowed) and not is_private


def test_modules_import_and_cimport_what_the_table_allows():
    assert [name for name in IMPORTS if package_of(name) is None] == []
    assert [
        f"{module}, line {one.line}: {one.module}"
        for module, found in IMPORTS.items()
        for one in found
        if not is_allowed(module, one.module)
    ] == []


def test_the_engine_asks_the_installation_only_for_the_version():
    of_engine = [one.module for module, found in IMPORTS.items() if top(module) == "tf2_py" for one in found]
    assert [one for one in of_engine if top(one) == "tf2_ros_cython"] == ["tf2_ros_cython._version"]


OF_TOOLS = {
    *("tf2_ros_tools", "rosbags", "mcap", "mcap_protobuf", "mcap_ros2"),
    *("textual", "matplotlib", "graphviz"),
}


def test_the_core_and_its_tests_import_neither_the_tools_nor_their_libraries():
    assert "tests.conftest" in IMPORTS
    assert [
        f"{module}, line {one.line}: {one.module}"
        for module, found in IMPORTS.items()
        for one in found
        if top(one.module) in OF_TOOLS
    ] == []


def test_no_two_folders_import_each_other():
    needed = {}
    for module, found in IMPORTS.items():
        if top(module) in PACKAGES:
            needed.setdefault(package_of(module), set()).update(package_of(one.module) for one in found)
    # All use what lies directly in tf2_ros.
    folders = {one for one in needed if one.startswith("tf2_ros._")}
    assert len(folders) >= 4
    assert [
        (one, other) for one in folders for other in needed[one] & folders - {one} if one in needed[other]
    ] == []


def test_no_modules_import_each_other_in_a_circle():
    # Without the packages themselves, which import their modules for their users.
    graph = {
        module: {one.module for one in found if one.module in modules() and one.module not in PACKAGES}
        for module, found in IMPORTS.items()
        if top(module) in PACKAGES and module not in PACKAGES
    }
    for module in graph:
        graph[module].discard(module)  # a .pyx and its .pxd
    while free := {module for module, needed in graph.items() if not needed & graph.keys()}:
        for module in free:
            del graph[module]
    assert graph == {}


MODULES_OF_CHAPTERS = ["tf2_py._core", "tf2_py._tf2_py"]


def test_a_chapter_uses_no_underscored_name_of_another():
    # Also of another extension: one cimports all names of the other.
    names = [name for module in MODULES_OF_CHAPTERS for name in (*chapters(module), module)]
    codes = {
        name: code_of("\n".join(path.read_text(encoding="utf-8") for path in modules()[name]))
        for name in names
    }
    # Two underscores are the compiler's.
    private = {
        name: {one for one in defined(code) if re.match("_(?!_)", one)} for name, code in codes.items()
    }
    assert "_history_slot" in private["tf2_py.core.history"]
    words = {name: set(re.findall(r"(?<![.\w])_\w+", code)) for name, code in codes.items()}
    methods = {
        name: set(re.findall(r"^    c?p?def [^\n(]*\b(\w+)\(", code, re.M)) for name, code in codes.items()
    }
    assert [
        f"{user} uses {word} of {owner}"
        for user in names
        for owner in names
        for word in sorted((words[user] - private[user] - methods[user]) & private[owner])
    ] == []


@pytest.mark.parametrize("module", MODULES_OF_CHAPTERS)
def test_a_chapter_uses_only_those_before_it(module):
    codes = {
        name: code_of("\n".join(path.read_text(encoding="utf-8") for path in modules()[name]))
        for name in chapters(module)
    }
    words = {name: set(re.findall(r"\w+", code)) for name, code in codes.items()}
    names = {name: defined(code) for name, code in codes.items()}
    known: set[str] = set()
    for chapter in codes:
        own = names[chapter] | known
        later = {
            other: found
            for other in list(codes)[list(codes).index(chapter) + 1 :]
            if (found := words[chapter] & (names[other] - own))
        }
        assert later == {}, f"{chapter} uses later chapters"
        known |= names[chapter]
