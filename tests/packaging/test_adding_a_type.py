"""The worked example of docs/adding-a-type.md, applied to a copy of the package, compiled and tested."""

import os
import re
import sys

import pytest
from installing import checkout_copy, reuse_builds
from paths import ROOT, TESTS
from processes import run

pytestmark = [pytest.mark.ours, pytest.mark.long("compiles an extension"), pytest.mark.timeout(1200)]

PAGE = (ROOT / "docs" / "adding-a-type.md").read_text()
# By the file that the first line of a block names.
BLOCKS = dict(re.findall(r"^```cython\n# (\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A copy of the checkout with the function and its row, built; without the line of the stub."""
    folder = checkout_copy(tmp_path_factory.mktemp("example") / "project")
    reuse_builds(folder)
    package = folder / "tf2_geometry_msgs"
    source, table = package / "_geometry.pyx", package / "_types.py"
    source.write_text(source.read_text() + "\n\n" + BLOCKS["tf2_geometry_msgs/_geometry.pyx"])
    table.write_text(insert_row(table.read_text(), BLOCKS["tf2_geometry_msgs/_types.py"]))
    done = run_in(folder, "setup.py", "-q", "build_ext", "--inplace")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_function_and_the_class_import_from_the_package(folder):
    names = f"do_transform_polygon_instance_stamped, {TYPE}"
    done = run_in(folder, "-c", f"from tf2_geometry_msgs import {names}; print({TYPE}.__name__)")
    assert (done.stdout.split(), done.stderr) == ([TYPE], "")


def test_the_tests_of_all_types_hold_for_the_new_one_and_ask_for_its_stub(folder):
    line = BLOCKS["tf2_geometry_msgs/_geometry.pyi"]
    first = run_tests(folder, "test_every_type.py", "test_types_table.py")
    assert re.search(r"^1 failed, [1-9]\d passed", first.stdout, re.MULTILINE), first.stdout + first.stderr
    assert f"_geometry.pyi needs: {line}" in first.stdout
    stub = folder / "tf2_geometry_msgs" / "_geometry.pyi"
    stub.write_text(stub.read_text() + line)
    second = run_tests(folder, "test_types_table.py")
    assert second.returncode == 0, second.stdout


def test_a_program_registers_a_type_of_its_own(tmp_path):
    [program] = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    done = run_in(tmp_path, "-c", program)
    assert (done.stdout, done.stderr) == ("2.0\n", "")
