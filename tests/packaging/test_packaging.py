# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What gets installed, the same wherever it is built."""

import importlib.metadata
import os
import tarfile
import zipfile

import pytest
from installing import OURS, build, checkout_copy, unsourced
from paths import ROOT
from processes import output_of
from sourced_installations import Prefix, sourced


@pytest.fixture(autouse=True)
def nothing_sourced(monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def test_numpy_is_all_that_an_install_without_extras_needs():
    requirements = importlib.metadata.requires("tf2-ros-cython")
    assert [text for text in requirements if "extra ==" not in text] == ["numpy>=1.21"]
    assert {"ros", "test", "docs", "dev"} == set(
        importlib.metadata.metadata("tf2-ros-cython").get_all("Provides-Extra")
    )


def test_the_packages_are_those_of_the_checkout():
    """The build finds them by their names; what is installed lists them in the order of their layers."""
    folders = {path.parent.name for path in ROOT.glob("tf2_*/__init__.py")}
    assert folders == {*OURS, "tf2_ros_cython"}


def test_source_distribution_holds_what_a_build_needs(tmp_path):
    project = checkout_copy(tmp_path / "project")
    with tarfile.open(build("build_backend.build_sdist", project, tmp_path / "made")) as opened:
        held = {name.partition("/")[2] for name in opened.getnames()}
    files = [path for folder in ("tf2_*", "build_backend") for path in project.glob(f"{folder}/**/*")]
    files += project.glob("messages/**/*")
    # The build itself leaves bytecode there.
    files = [path for path in files if path.is_file() and path.suffix != ".pyc"]
    sources = {str(path.relative_to(project)) for path in files}
    assert sources | {"setup.py", "setup.cfg", "pyproject.toml", "LICENSE"} <= held
    assert {"package.xml", "resource/tf2_ros_cython"} <= held
    assert not [name for name in held if name.endswith((".so", ".c", ".cpp"))]


@pytest.mark.long("builds three wheels")
def test_wheel_holds_the_same_wherever_it_is_built(tmp_path):
    """Nothing of an earlier build, and nothing that depends on a ROS 2, nor on the choice of one."""
    project = checkout_copy(tmp_path / "project")
    for source in project.glob("tf2_*/**/*.pyx"):
        source.unlink()  # compiling them takes long and decides nothing here
    for left in ("tf2_msgs/__init__.py", "tf2_py/gone.py"):
        (project / "build" / "lib" / left).parent.mkdir(parents=True, exist_ok=True)
        (project / "build" / "lib" / left).touch()
    held = []
    whole = Prefix(tmp_path / "jazzy").mark("rclpy", "tf2_msgs")
    bare = Prefix(tmp_path / "workspace").mark("rclpy")
    for name, ros in (("none", unsourced()), ("whole", sourced(whole)), ("bare", sourced(bare))):
        made = build("build_backend.build_wheel", project, tmp_path / name, {"ros": "kilted"}, ros)
        with zipfile.ZipFile(made) as opened:
            held.append({entry: opened.read(entry) for entry in opened.namelist()})
    assert held[0] == held[1] == held[2]
    assert "tf2_ros_cython/packages/tf2_py/__init__.py" in held[0]
    assert not [name for name in held[0] if name.endswith("gone.py")]
    # Neither tf2_msgs nor anything of the tools, of the tests or of the build.
    assert first_parts(held[0]) == {"tf2_ros_cython", "tf2_ros_cython.pth"}
    inner = {name.split("/")[2] for name in held[0] if name.startswith("tf2_ros_cython/packages/")}
    assert inner == {*OURS}
    made = build("build_backend.build_wheel", project, tmp_path / "opt-in", {"precedence": "opt-in"})
    with zipfile.ZipFile(made) as opened:
        assert {*opened.namelist()} == {*held[0], "tf2_ros_cython/opt_in"}
    refused = "expected precedence=opt-out or precedence=opt-in, got precedence=odd"
    with pytest.raises(AssertionError, match=refused):
        build("build_backend.build_wheel", project, tmp_path / "odd", {"precedence": "odd"})


def first_parts(names):
    return {name.partition("/")[0] for name in names if not name.startswith("tf2_ros_cython-")}


def test_pytest_runs_without_the_plugins_of_a_sourced_ros(tmp_path):
    """On Jazzy, pytest 9 refuses their hooks."""
    for name in ("launch_testing", "launch_pytest", "launch_ros"):
        (tmp_path / f"{name}_plugin.py").write_text("def pytest_pycollect_makemodule(path, parent): ...")
        information = tmp_path / f"{name}-1.0.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(f"Name: {name}\nVersion: 1.0.0\n")
        (information / "entry_points.txt").write_text(f"[pytest11]\n{name} = {name}_plugin\n")
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ['PYTHONPATH']}"}
    collecting = ["-m", "pytest", "--collect-only", "-q", "tests/core/test_lookup.py"]
    assert "test_lookup.py" in output_of(*collecting, cwd=ROOT, env=environment)
