# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registered types: what follows from a line in a table of types, and which lines of a stub it needs."""

import importlib
import inspect
import re
from pathlib import Path

import pytest
from type_tables import TABLES

from tf2_ros._registration import _REGISTERED_BY
from tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration

every_package = pytest.mark.parametrize("package", TABLES)
every_row = pytest.mark.parametrize(
    ("package", "cls"),
    [(package, cls) for package, table in TABLES.items() for cls in table],
    ids=lambda x: x if isinstance(x, str) else x.__name__,
)


@every_row
def test_a_type_of_the_table_is_registered_and_its_message_package_says_by_whom(package, cls):
    function = TABLES[package][cls]
    assert TransformRegistration().get(cls) is function
    message = cls()
    assert ConvertRegistration().get_to_msg(cls)(message) is message
    assert ConvertRegistration().get_from_msg(cls)(message) is message
    messages = cls.__module__.partition(".")[0]
    assert _REGISTERED_BY.get(messages) == package, (
        f'tf2_ros/_registration.py needs in _REGISTERED_BY: "{messages}": "{package}",'
    )


@every_package
def test_functions_of_the_table_import_from_the_package(package):
    for function in TABLES[package].values():
        assert getattr(importlib.import_module(package), function.__name__) is function


def stub_line(function, table):
    """What a stub has for a function of the table."""
    message, transform = list(inspect.signature(function).parameters)[:2]
    classes = [cls for cls in table if table[cls] is function]
    wanted = "TransformStamped" if hasattr(classes[0], "header") else "TransformStamped | Transform"
    name = " | ".join(cls.__name__ for cls in classes)
    return f"def {function.__name__}({message}: {name}, {transform}: {wanted}) -> {name}: ..."


def root_of(package):
    return Path(importlib.import_module(package).__file__).parents[1]


@every_package
def test_a_function_of_the_table_has_its_line_in_the_stub_beside_its_source(package):
    root = root_of(package)
    for function in set(TABLES[package].values()):
        path = root / (function.__module__.replace(".", "/") + ".pyi")
        # Whether the parameters agree finds stubtest, in tests/packaging/test_type_checkers.py.
        if f"def {function.__name__}(" not in path.read_text():
            pytest.fail(f"{path.relative_to(root)} needs: {stub_line(function, TABLES[package])}")


def test_the_documentation_lists_the_types_of_the_tables():
    page = "docs/message-types.md"
    listed, rows = set(), {}
    for number, line in enumerate((root_of("tf2_ros") / page).read_text(encoding="utf-8").splitlines(), 1):
        if row := re.fullmatch(r"\| `(\w+)` \| (.*) \| (.*) \| `(\w+)` \|", line):
            messages, *columns, package = row.groups()
            rows[messages, package] = number
            for names, has_header in zip(columns, (True, False), strict=True):
                listed |= {(messages, package, name, has_header) for name in re.findall(r"`(\w+)`", names)}
    registered = {
        (cls.__module__.partition(".")[0], package, cls.__name__, hasattr(cls, "header"))
        for package, table in TABLES.items()
        for cls in table
    }
    for messages, package, name, has_header in sorted(registered - listed):
        where = f"line {rows[messages, package]}" if (messages, package) in rows else f"a row of `{messages}`"
        pytest.fail(f"{page}, {where}: add `{name}` to the types with{'' if has_header else 'out'} a header")
    for messages, package, name, _ in sorted(listed - registered):
        pytest.fail(f"{page}, line {rows[messages, package]}: `{name}` is not registered by {package}")
