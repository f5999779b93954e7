# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The example of new-message-type.md, applied to a copy of the package, compiled and tested."""

import os
import re
import sys

import pytest
from documentation_pages import blocks
from installing import checkout_copy, reuse_builds
from paths import ROOT, TESTS
from processes import run

pytestmark = pytest.mark.long("compiles an extension")

PAGE = ROOT / "docs" / "development" / "new-message-type.md"
# By the file that the first line of a block names.
BLOCKS = {
    name.removeprefix("# "): code
    for block in blocks(PAGE)
    if block.language == "cython"
    for name, _, code in [block.code.partition("\n")]
}
TYPE = "PolygonInstanceStamped"


def run_in(folder, *arguments):
    """In a folder whose packages precede those of the project."""
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    return run(sys.executable, *arguments, cwd=folder, env=environment)


def run_tests(folder, *files):
    paths = [str(TESTS / "core" / file) for file in files]
    options = ["-q", "-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml"), "-k", f"{TYPE} or stub"]
    return run_in(folder, "-m", "pytest", *options, *paths)


def insert_row(table, row):
    """Put a row of a table where its rows stay in order."""
    lines = table.splitlines(keepends=True)
    prefix = row.partition(".")[0] + "."
    place = next(i for i, line in enumerate(lines) if line.startswith(prefix) and line > row)
    return "".join([*lines[:place], row, *lines[place:]])


def test_the_example_compiles_and_the_tests_of_all_types_hold_for_it_and_ask_for_its_stub(tmp_path):
    folder = checkout_copy(tmp_path / "project")
    reuse_builds(folder)
    package = folder / "tf2_geometry_msgs"
    source, table, stub = (package / name for name in ("_geometry.pyx", "_type_table.py", "_geometry.pyi"))
    source.write_text(source.read_text() + "\n\n" + BLOCKS["tf2_geometry_msgs/_geometry.pyx"])
    table.write_text(insert_row(table.read_text(), BLOCKS["tf2_geometry_msgs/_type_table.py"]))
    done = run_in(folder, "setup.py", "-q", "build_ext", "--inplace")
    assert done.returncode == 0, done.stdout + done.stderr
    function = "do_transform_polygon_instance_stamped"
    done = run_in(folder, "-c", f"from tf2_geometry_msgs import {function}; print({function}.__name__)")
    assert (done.stdout.split(), done.stderr) == ([function], "")
    line = BLOCKS["tf2_geometry_msgs/_geometry.pyi"]
    first = run_tests(folder, "test_every_message_type.py", "test_type_tables.py")
    assert re.search(r"^1 failed, [1-9]\d passed", first.stdout, re.MULTILINE), first.stdout + first.stderr
    assert f"_geometry.pyi needs: {line}" in first.stdout
    stub.write_text(stub.read_text() + line)
    second = run_tests(folder, "test_type_tables.py")
    assert second.returncode == 0, second.stdout
