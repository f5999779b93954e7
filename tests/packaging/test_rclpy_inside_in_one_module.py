# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is assumed of rclpy's inside stands in one module, ``tf2_ros._rclpy``, and in its table."""

import re
from functools import cache

import pytest
from project_sources import PACKAGES, code_of, modules

from tf2_py._internal import assumptions
from tf2_ros import _rclpy

# Of Python, of the messages of rosidl, and of the build, which writes that module.
OF_OTHERS = {"_getframe", "_replace", "_check_fields", "_built"}
# Public, but not documented: by what is used, the modules that do.
UNDOCUMENTED = {
    r"\b(Impl|ClientGoalHandle|GuardCondition|EventHandler|co_filename|co_varnames)\b": {"_rclpy.py"},
    r"(?<!self)\.(callback|destroy) = ": {"_rclpy.py"},
    r"\bending_execution\b": {"call_runners.py"},
    r"\.pointer\b": {"_rcl.pyx", "executor_waitable.pyx", "subscriptions.pyx"},
}


def test_only_one_module_knows_rclpys_inside():
    of_rclpy = {
        (path.name, found[0].lstrip("."))
        for path, code in code_of_packages()
        for found in re.finditer(r"\._[a-z]\w*", code)
        if found[0][1:] not in own_private_names()
    }
    # The memory behind a Time or Duration is found by a name in a text.
    of_rclpy |= {
        (path.name, name)
        for path, _ in code_of_packages()
        for name in re.findall(r'"(_[a-z]+_handle)"', path.read_text())
    }
    assert {("_rclpy.py", "_is_shutdown"), ("times.pxi", "_time_handle")} <= of_rclpy
    assert {name for name, _ in of_rclpy} == {"_rclpy.py", "times.pxi"}, of_rclpy
    assert _rclpy.IS_SHUTDOWN in assumptions.ROWS
    rows = {name for row in assumptions.ROWS for name in re.findall(r"\b_\w+", row.used)}
    assert {name for _, name in of_rclpy} <= rows


@pytest.mark.parametrize("used", UNDOCUMENTED)
def test_only_these_modules_use_what_rclpy_does_not_document(used):
    assert {path.name for path, code in code_of_packages() if re.search(used, code)} == UNDOCUMENTED[used]


@cache
def own_private_names():
    """Modules, and whatever the packages define, assign or declare."""
    names = {part for module in modules(packages=PACKAGES) for part in module.split(".")} | OF_OTHERS
    for path, code in code_of_packages():
        names.update(re.findall(r"(?:\bdef |\bclass |\b(?:self|cls)\.|^\s*)(_[a-z]\w*)", code, re.MULTILINE))
        if path.suffix in (".pyx", ".pxd", ".pxi"):
            declared = re.findall(r"^\s*(?:cdef|cpdef|ctypedef)\b[^\n=]*", code, re.MULTILINE)
            names.update(name for line in declared for name in re.findall(r"\b_[a-z]\w*", line))
    return names


@cache
def code_of_packages():
    paths = {path for all_of in modules(packages=PACKAGES).values() for path in all_of}
    return [(path, code_of(path.read_text())) for path in sorted(paths) if path.suffix != ".pyi"]
