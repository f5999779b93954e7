"""The direction of imports: the table in docs/internals.md, and what the sources import and cimport."""

import re
import runpy
import sys

import pytest
from paths import ROOT
from sources import PACKAGES, imports, modules

pytestmark = pytest.mark.ours

INTERNALS = ROOT / "docs" / "internals.md"
HEADER = ["package", "owns", "imports", "beside the standard libraries", "underscored modules open to others"]
ANYTHING = "anything"
# What Cython brings: C's, POSIX's and Python's own declarations.
STANDARD = {"libc", "posix", "cpython", "cython", *sys.stdlib_module_names}


class Row:
    """A line of the table."""

    def __init__(self, cells):
        self.name, self.allowed, self.outside, self.open = (
            re.findall(r"`([^`]+)`", cells[i]) or [cells[i]] for i in (0, 2, 3, 4)
        )
        [self.name] = self.name

    def may_import(self, row):
        return self.allowed == [ANYTHING] or row in (self.name, *self.allowed)


def read_table():
    lines = INTERNALS.read_text(encoding="utf-8").splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    start = cells.index(HEADER) + 2
    rows = []
    for i in range(start, len(lines)):
        if not lines[i].startswith("|"):
            break
        rows.append(Row(cells[i]))
    return {row.name: row for row in rows}


TABLE = read_table()
# The imports of each module, of all its files; those of the packages themselves are among them.
IMPORTS = {name: [one for path in paths for one in imports(path)] for name, paths in modules().items()}


def row_of(module):
    """The line of the table that a module belongs to: the longest name that is a part of its own."""
    return max((name for name in TABLE if is_within(module, name)), key=len, default=None)


def is_within(module, package):
    return module == package or module.startswith(package + ".")


def top(module):
    return module.partition(".")[0]


def ours(module):
    return row_of(module) is not None


def found(wrong):
    """The imports for which `wrong` holds, as lines to read."""
    return [
        f"{module}, line {one.line}: {one.module}"
        for module, all_of_them in IMPORTS.items()
        for one in all_of_them
        if wrong(module, one)
    ]


def test_every_module_has_a_line_in_the_table():
    assert [name for name in modules() if row_of(name) is None] == []
    assert {top(name) for name in modules()} >= set(PACKAGES)


def test_imports_and_cimports_go_in_the_direction_of_the_table():
    def against_the_table(module, one):
        return ours(one.module) and not TABLE[row_of(module)].may_import(row_of(one.module))

    assert found(against_the_table) == []


def test_the_table_knows_what_is_imported_from_outside_the_project():
    def undeclared(module, one):
        outside = TABLE[row_of(module)].outside
        return not (ours(one.module) or top(one.module) in STANDARD or top(one.module) in outside)

    def is_checked(module):
        return TABLE[row_of(module)].outside != [ANYTHING]

    assert found(lambda module, one: is_checked(module) and undeclared(module, one)) == []


def test_the_core_imports_no_python_of_this_project():
    core = {"tf2_py._core", "tf2_py.core"}
    assert found(lambda module, one: row_of(module) in core and ours(one.module) and not one.is_cimport) == []
    assert [TABLE[name].outside for name in core] == [["nothing"], ["nothing"]]


def test_underscored_modules_of_another_package_are_used_only_where_the_table_opens_them():
    def is_private(module, one):
        if not ours(one.module) or top(one.module) == top(module):
            return False
        underscored = any(part.startswith("_") for part in one.module.split("."))
        may_use_it = one.module in opened() or TABLE[row_of(module)].allowed == [ANYTHING]
        return underscored and not may_use_it

    assert found(is_private) == []


def opened():
    return {f"{row.name}.{name}" for row in TABLE.values() for name in row.open if name != "none"}


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


def test_the_drawing_on_the_page_is_what_the_sources_import_and_cimport():
    drawn = runpy.run_path(str(ROOT / "docs" / "imports.py"))["drawing"]()
    page = INTERNALS.read_text(encoding="utf-8")
    assert f"```text\n{drawn}\n```" in page, f"put this into docs/internals.md:\n{drawn}"
