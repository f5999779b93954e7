# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The package of docs/creating-a-package.md: colcon builds it, its test passes, and its files agree."""

import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from documentation_pages import blocks
from paths import ROOT
from processes import output_of

PAGE = ROOT / "docs" / "creating-a-package.md"
# The first line of a block is a comment with the name of its file.
NAME = re.compile(r"(?:# |<!-- )([\w./]+\.(?:xml|py|cfg))(?: -->)?\n")


@pytest.fixture
def package(tmp_path):
    """The files of the page, and the empty ones that its tree of files names."""
    path = tmp_path / "workspace" / "src" / "my_robot"
    files = {found[1]: block.code for block in blocks(PAGE) if (found := NAME.match(block.code))}
    for name in ("resource/my_robot", "my_robot/__init__.py"):
        files[name] = ""
    for name, text in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_text(text, encoding="utf-8")
    return path


def test_the_tree_on_the_page_is_that_of_its_files(package):
    [tree] = [block.code for block in blocks(PAGE) if "workspace/src/my_robot/" in block.code]
    drawn = {line.split()[0] for line in tree.splitlines()[1:]}
    assert drawn == {str(path.relative_to(package)) for path in package.rglob("*") if path.is_file()}


def test_the_test_of_the_package_passes(package):
    path = os.pathsep.join([str(package), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}
    output_of("-m", "pytest", "--rootdir", package, "test", cwd=package, env=environment)


def test_the_launch_file_starts_what_the_package_installs(package):
    launched = (package / "launch" / "robot.launch.py").read_text(encoding="utf-8")
    [executable] = re.findall(r'package="my_robot",\s+executable="(\w+)"', launched)
    assert f"{executable} = " in (package / "setup.py").read_text(encoding="utf-8")


@pytest.mark.long("builds a package")
def test_colcon_builds_the_package_and_its_node_uses_the_python_on_path(package):
    pytest.importorskip("colcon_ros")
    colcon = Path(sysconfig.get_path("scripts"), "colcon")
    workspace = package.parent.parent
    subprocess.run([colcon, "build"], cwd=workspace, check=True)
    installed = workspace / "install" / "my_robot"
    script = installed / "lib" / "my_robot" / "scan_pose"
    assert script.read_text(encoding="utf-8").startswith("#!/usr/bin/env python3\n")
    assert (installed / "share" / "my_robot" / "launch" / "robot.launch.py").is_file()
