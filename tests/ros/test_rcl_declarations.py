# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the receiver declares of rcl is what the headers of the ROS 2 that runs say."""

import os
import re
from pathlib import Path

from processes import output_of, run

import tf2_ros
from tf2_ros_cython import _ros_in_use

DECLARATIONS = Path(tf2_ros.__file__).resolve().parent / "_rcl.pxd"
INCLUDES = """
#include <stdbool.h>
#include <stddef.h>
#include <rcl/rcl.h>
#include <rcl/error_handling.h>
#include <rmw/types.h>
"""
# What rcl fills in, and may have more members than are declared.
WITH_ROOM = ("rmw_gid_t", "rmw_message_info_t")
# Pointers to what the receiver has no use for.
POINTERS = ("const void**", "void*")


def c_of(text):
    """A program in C that compiles only if the declarations agree with the headers."""
    text = re.sub(r"#.*", "", text).replace("c_bool", "bool")
    lines = [INCLUDES]
    for name, value in re.findall(r"^    (\w+) = (\d+)$", text, re.MULTILINE):
        lines.append(f'_Static_assert({name} == {value}, "{name}");')
    structs = re.findall(r"^ctypedef struct (\w+):\n((?:    .*\n)+)", text, re.MULTILINE)
    assert len(structs) == 4
    for name, fields in structs:
        lines += struct_checks(
            name, re.findall(r"^    (\S.*?)(?:\[(\w+)\])? +(\w+) *$", fields, re.MULTILINE)
        )
    functions = re.findall(r"^cdef ([\w ]+) \(\*(\w+)\)\(([^()]*)\) noexcept nogil$", text, re.MULTILINE)
    callbacks = re.findall(r"^ctypedef (\w+) \(\*(\w+)\)\(([^()]*)\) noexcept nogil$", text, re.MULTILINE)
    assert len(functions) + len(callbacks) == text.count("(*")
    for returned, name, taken in callbacks:
        lines.append(f"typedef {returned} (*our_{name})({taken});")
        lines.append(f'_Static_assert(__builtin_types_compatible_p(our_{name}, {name}), "type of {name}");')
    for returned, name, taken in functions:
        lines.append(f"{returned} (*our_{name})({taken.strip().rstrip(',') or 'void'}) = {name};")
    return "\n".join([*lines, ""])


def struct_checks(name, fields):
    assert fields
    yield f"typedef struct {{ {' '.join(declaration(*field) for field in fields)} }} our_{name};"
    compared = "<=" if name in WITH_ROOM else "=="
    yield f'_Static_assert(sizeof(our_{name}) {compared} sizeof({name}), "size of {name}");'
    for kind, size, field in fields:
        yield f'_Static_assert(offsetof(our_{name}, {field}) == offsetof({name}, {field}), "{name}.{field}");'
        if kind in POINTERS:
            yield f"static inline const void *{name}_{field}({name} *of) {{ return of->{field}; }}"
        elif not size:
            kind_of = f"__typeof__((({name} *)0)->{field})"
            compatible = f"__builtin_types_compatible_p({kind}, {kind_of})"
            yield f'_Static_assert({compatible}, "type of {name}.{field}");'


def declaration(kind, size, name):
    return f"{kind} {name}[{size}];" if size else f"{kind} {name};"


def prefixes():
    sourced = [Path(entry) for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if entry]
    return [prefix for prefix in sourced if (prefix / "include").is_dir()] or [_ros_in_use.running_prefix()]


def test_all_declarations_agree_with_the_headers(tmp_path):
    packages = [package for prefix in prefixes() for package in (prefix / "include").iterdir()]
    folders = [f"-I{package}" for package in packages if (package / package.name).is_dir()]
    source = tmp_path / "checks.c"
    source.write_text(c_of(DECLARATIONS.read_text()))
    done = run("gcc", "-std=gnu11", "-fsyntax-only", "-Werror", *folders, source)
    assert done.returncode == 0, done.stderr


def test_without_a_function_of_rcl_nothing_is_called():
    program = (
        "import ctypes\n"
        "class Lacking(ctypes.PyDLL):\n"
        "    def __getitem__(self, name):\n"
        "        return super().__getitem__(name.replace('rcl_take', 'rcl_took'))\n"
        "ctypes.PyDLL = Lacking\n"
        "from tf2_ros._rcl import problem\n"
        "print(problem())\n"
        "from tf2_ros._receive.subscriptions import Subscriptions\n"
        "try: Subscriptions()\n"
        "except RuntimeError as refused: print(str(refused) == problem())\n"
    )
    said, is_the_same = output_of("-c", program).splitlines()
    assert said.startswith("rclpy's library lacks functions that listeners need: ")
    assert "undefined symbol: rcl_took_serialized_message" in said
    assert is_the_same == "True"
