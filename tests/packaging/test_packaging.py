# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What gets installed of both projects, the same wherever it is built; and what a refusal says."""

import email
import importlib.metadata
import os
import shutil
import sys
import tarfile
import zipfile

import pytest
import setuptools
from installing import OURS, Prefix, backend_at, build, checkout_copy, messages_copy, sourced, unsourced
from packaging.requirements import Requirement
from paths import ROOT
from processes import output_of, run
from setuptools._distutils.core import run_setup
from setuptools.command.develop import develop

from tf2_ros_cython import which

# By their places and not by the path: that must not make the checkout's packages importable.
environment = backend_at(ROOT / "build_backend", "build_backend").required_tools
messages = backend_at(ROOT / "messages" / "backend", "messages_backend").ros_to_build_for
MESSAGES_METADATA = "backend.prepare_metadata_for_build_wheel"


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    monkeypatch.setenv("_TF2_MSGS_RELEASE", "")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


@pytest.mark.parametrize(
    ("build_of", "said"),
    [(environment, ""), (messages, r"; no C\+\+ compiler .*install g\+\+")],
    ids=["tf2-ros-cython", "tf2_msgs"],
)
def test_missing_compilers_are_named_with_what_to_install(tmp_path, build_of, said):
    with pytest.raises(SystemExit, match=f"no C compiler .*install gcc{said}"):
        build_of.refuse_incomplete({"PATH": str(tmp_path)})


def install_cython(monkeypatch, folder, version):
    if version:
        (folder / "Cython.py").write_text(f"__version__ = {version!r}")
    monkeypatch.setattr(sys, "path", [str(folder)])
    monkeypatch.setitem(sys.modules, "Cython", None)  # so that what is imported now is not there afterwards
    monkeypatch.delitem(sys.modules, "Cython")


@pytest.mark.parametrize("installed", ["0.29.32", "3.0.7", "3.3.0", "3.3.0a1", "4.0", None])
def test_another_cython_is_refused_with_what_to_install(monkeypatch, tmp_path, installed):
    install_cython(monkeypatch, tmp_path, installed)
    said = f"has {installed or 'none'}: with that Python, pip install 'Cython>=3.0.8,<3.3', or"
    with pytest.raises(SystemExit, match=said):
        environment.refuse_other_cython()


# Of Ubuntu 24.04, Debian 13 and PyPI.
@pytest.mark.parametrize("installed", ["3.0.8", "3.0.11", "3.0.11+dfsg", "3.1.6", "3.2.0b1", "3.2.9"])
def test_the_cythons_of_distributions_may_build(monkeypatch, tmp_path, installed):
    install_cython(monkeypatch, tmp_path, installed)
    environment.refuse_other_cython()


def test_an_old_python_is_refused_before_setuptools_is_asked(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 18, "final", 0))
    monkeypatch.setitem(sys.modules, "setuptools", None)
    with pytest.raises(SystemExit, match="needs Python 3.10 or newer, and this is 3.9"):
        backend_at(ROOT / "build_backend", "build_backend_of_an_old_python")


def test_the_setuptools_of_ubuntu_22_is_refused_as_colcon_runs_it(monkeypatch):
    monkeypatch.setattr(setuptools, "__version__", "59.6.0")
    monkeypatch.setitem(sys.modules, "setuptools.config.pyprojecttoml", None)
    with pytest.raises(RuntimeError, match="setuptools 59.6.0, .*: run pip install in a virtual environment"):
        run_setup(ROOT / "setup.py", stop_after="config")


def test_links_that_setuptools_cannot_make_are_refused_as_colcon_asks_for_them(monkeypatch):
    """By a colcon-core before 0.21, which does not know setuptools 80 and newer."""
    monkeypatch.setattr(develop, "user_options", [("no-deps", "N", "")])
    with pytest.raises(RuntimeError, match="--symlink-install does not work .*: update colcon-core to 0.21"):
        run_setup(ROOT / "setup.py", ["develop", "--editable", "--no-deps"], stop_after="config")


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
    made = build("build_backend.build_wheel", project, tmp_path / "flat", {"layout": "flat"})
    with zipfile.ZipFile(made) as opened:
        assert first_parts(opened.namelist()) == {*first_parts(held[0]), *OURS}
    made = build("build_backend.build_wheel", project, tmp_path / "opt-in", {"precedence": "opt-in"})
    with zipfile.ZipFile(made) as opened:
        assert {*opened.namelist()} == {*held[0], "tf2_ros_cython/opt_in"}
    for name, refused in {
        "layout": "expected layout=private or layout=flat, got layout=odd",
        "precedence": "expected precedence=opt-out or precedence=opt-in, got precedence=odd",
    }.items():
        with pytest.raises(AssertionError, match=refused):
            build("build_backend.build_wheel", project, tmp_path / f"odd-{name}", {name: "odd"})


def first_parts(names):
    return {name.partition("/")[0] for name in names if not name.startswith("tf2_ros_cython-")}


def without_editables(folder):
    """An environment in which no extensions of this checkout are found for another one."""
    kept = "[one for one in sys.meta_path if 'editable' not in getattr(one, '__module__', '')]"
    (folder / "sitecustomize.py").write_text(f"import sys\nsys.meta_path[:] = {kept}\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


@pytest.mark.parametrize(
    ("held", "said"),
    [
        (
            "_tf2_py.cpython-38-riscv64-linux-gnu.so",
            "{home} is built for Python 3.8 (riscv64-linux-gnu), but this is Python {version}, {python}. "
            "Start the other Python, remove the folder from PYTHONPATH, or install tf2-ros-cython into this "
            "one",
        ),
        (None, "{home} lacks it. With {python}, reinstall tf2-ros-cython"),
    ],
    ids=("another Python's", "incomplete"),
)
def test_an_installation_without_modules_for_this_python_names_both(tmp_path, held, said):
    for package in ("tf2_py", "tf2_ros_cython"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("*.so"))
    if held:
        (tmp_path / "tf2_py" / held).touch()
    ended = run(sys.executable, "-c", "import tf2_py", cwd=tmp_path, env=without_editables(tmp_path))
    version = "{}.{}".format(*sys.version_info)
    wanted = said.format(home=tmp_path, version=version, python=sys.executable)
    assert ended.stderr.splitlines()[-1] == f"ModuleNotFoundError: tf2_py._tf2_py is missing: {wanted}"


def test_sources_of_another_version_than_the_build_are_named(monkeypatch, capsys):
    built = which.__version__
    monkeypatch.setattr(which, "__version__", "0.0.1")
    which.main(["tf2_which"])
    said = f"version: tf2-ros-cython 0.0.1 (but the sources are {built}: run `make build` in {ROOT})"
    assert capsys.readouterr().out.splitlines()[-1].startswith(said)
    monkeypatch.undo()
    which.main(["tf2_which"])
    assert f"version: tf2-ros-cython {built}, " in capsys.readouterr().out


@pytest.mark.parametrize("package", OURS)
def test_a_checkout_that_is_not_built_says_what_to_do(tmp_path, package):
    project = checkout_copy(tmp_path / "project")
    ended = run(sys.executable, "-c", f"import {package}", cwd=project, env=without_editables(tmp_path))
    assert ended.returncode == 1
    [error] = [line for line in ended.stderr.splitlines() if line.startswith("ModuleNotFoundError: tf2_py.")]
    assert f" is missing: {project} is not built for Python " in error
    assert "`make build` there" in error and "change to another directory" in error
    assert "During handling" not in ended.stderr


# The messages: for which release they are built, what they are called, and where they are refused.


@pytest.mark.parametrize("release", ["jazzy", "kilted"])
def test_name_and_requirements_are_those_of_the_release(tmp_path, release):
    project = messages_copy(tmp_path / "project")
    folder = build(MESSAGES_METADATA, project, tmp_path / "made", {"ros": release})
    metadata = email.message_from_string((folder / "METADATA").read_text())
    assert metadata["Name"] == f"tf2-ros-cython-msgs-{release}"
    required = {text.partition("[")[0] for text in metadata.get_all("Requires-Dist")}
    assert {f"ros-{release}-rclpy", f"ros-{release}-common-interfaces"} <= required
    ours = [
        Requirement(text)
        for text in importlib.metadata.requires("tf2-ros-cython")
        if text.startswith(metadata["Name"]) and 'extra == "ros"' in text
    ]
    assert [metadata["Version"] in one.specifier for one in ours] == ([True] if release == "jazzy" else [])


def test_a_source_distribution_stays_with_its_release_and_holds_nothing_built(tmp_path):
    project = messages_copy(tmp_path / "project")
    made = ["_release.py", "msg/__init__.py", "srv/_frame_graph.py", "libtf2_msgs__x.so"]
    for name in made:
        (project / "src" / "tf2_msgs" / name).touch()
    archive = build("backend.build_sdist", project, tmp_path / "made", {"ros": "kilted"})
    assert archive.name.startswith("tf2_ros_cython_msgs_kilted-")
    filtered = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}  # not in Debian 12's 3.11.2
    with tarfile.open(archive) as opened:
        opened.extractall(tmp_path / "extracted", **filtered)
    [unpacked] = (tmp_path / "extracted").iterdir()
    package = unpacked / "src" / "tf2_msgs"
    for name in ("__init__.py", "msg/TFMessage.msg", "srv/FrameGraph.srv", "package.xml", "../../LICENSE"):
        assert (package / name).is_file()
    assert not [name for name in made if (package / name).exists()]
    folder = build(MESSAGES_METADATA, unpacked, tmp_path / "again")
    assert folder.name.startswith("tf2_ros_cython_msgs_kilted-")


def test_a_release_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(SystemExit, match="tf2_msgs knows no -C ros=humble: give one of jazzy, kilted"):
        messages.choose({"ros": "humble"})


@pytest.mark.parametrize(("version", "name"), [("7.1.5", "jazzy"), ("9.1.2", "kilted"), ("10.0.1", "jazzy")])
def test_the_release_is_that_of_the_wheels_that_are_installed(monkeypatch, tmp_path, version, name):
    """Build isolation hides the packages, and not the folder in which they lie."""
    manifest = tmp_path / "share" / "rclpy" / "package.xml"
    manifest.parent.mkdir(parents=True)
    manifest.write_text(f"<version>{version}</version>")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert messages.ros_wheels() == [f"ros-{name}-rclpy[fastrtps]", f"ros-{name}-common-interfaces"]


def test_beside_a_sourced_ros_nothing_is_built(tmp_path):
    prefix = Prefix(tmp_path)
    overlay = f"{tmp_path / 'gone'}{os.pathsep}{tmp_path}"
    messages.refuse_sourced({"AMENT_PREFIX_PATH": overlay})
    prefix.mark("rclpy")
    said = r"a ROS 2 is sourced \(.*\), whose own is used: .* apt install ros-"
    with pytest.raises(SystemExit, match=said):
        messages.refuse_sourced({"AMENT_PREFIX_PATH": overlay})


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
