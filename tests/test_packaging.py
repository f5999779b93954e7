"""What gets installed: ROS and tf2_msgs only where the environment lacks them; and what a refusal says."""

import importlib
import importlib.metadata
import importlib.util
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from installing import checkout_copy
from setuptools import Distribution, Extension

ROOT = Path(__file__).resolve().parents[1]

# By its place and not by the path: the path must not make the checkout's packages importable.
_spec = importlib.util.spec_from_file_location("build_backend", ROOT / "build_backend" / "__init__.py")
build_backend = importlib.util.module_from_spec(_spec)
sys.modules["build_backend"] = build_backend
_spec.loader.exec_module(build_backend)
environment = build_backend.environment
extensions = importlib.import_module("build_backend.extensions")
receiver = extensions.receiver


@pytest.fixture(autouse=True)
def path_of_its_own(monkeypatch):
    """The build runs setup.py in this process, which adds its folder; children of later tests inherit it."""
    monkeypatch.setattr(sys, "path", sys.path[:])


@pytest.fixture
def prefix(tmp_path):
    """An install prefix of ROS 2 with the packages named, as AMENT_PREFIX_PATH would list it."""

    def make(name, *packages):
        index = tmp_path / name / "share" / "ament_index" / "resource_index" / "packages"
        index.mkdir(parents=True)
        for package in packages:
            (index / package).touch()
        return str(tmp_path / name)

    return make


def sourced(*prefixes):
    return {"AMENT_PREFIX_PATH": os.pathsep.join(prefixes), "PATH": os.environ["PATH"]}


def test_tf2_msgs_is_built_where_nothing_is_sourced():
    assert environment.must_build_tf2_msgs({})
    assert environment.must_build_tf2_msgs({"AMENT_PREFIX_PATH": ""})


def test_tf2_msgs_is_built_where_the_sourced_ros_lacks_it(prefix):
    assert environment.must_build_tf2_msgs(sourced(prefix("jazzy", "rclpy")))


def test_tf2_msgs_of_any_sourced_prefix_is_not_shadowed(prefix):
    overlay, underlay = prefix("workspace"), prefix("jazzy", "rclpy", "tf2_msgs")
    assert not environment.must_build_tf2_msgs(sourced(overlay, underlay))


def test_a_prefix_that_is_gone_offers_nothing(tmp_path):
    assert environment.must_build_tf2_msgs(sourced(str(tmp_path / "gone")))


@pytest.mark.parametrize("hook", ["get_requires_for_build_wheel", "get_requires_for_build_editable"])
def test_ros_wheels_are_asked_for_only_where_no_ros_is_sourced(monkeypatch, tmp_path, prefix, hook):
    project = checkout_copy(tmp_path / "project")
    monkeypatch.chdir(project)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert "ros-jazzy-rclpy[fastrtps]" in getattr(build_backend, hook)({"ros": "jazzy"})
    assert "ros-kilted-rclpy[fastrtps]" in getattr(build_backend, hook)({"ros": "kilted"})
    assert not [name for name in getattr(build_backend, hook)({"ros": "none"}) if name.startswith("ros-")]
    monkeypatch.setenv("AMENT_PREFIX_PATH", prefix("jazzy", "rclpy"))
    assert not [name for name in getattr(build_backend, hook)() if name.startswith("ros-")]


def test_missing_compilers_are_named_with_what_to_install(tmp_path):
    with pytest.raises(SystemExit, match=r"no C compiler .*install gcc; no C\+\+ compiler .*install g\+\+"):
        environment.refuse_incomplete({"PATH": str(tmp_path)})


@pytest.mark.parametrize(("installed", "said"), [("3.1.8", "has 3.1.8"), (None, "has none")])
def test_an_old_cython_is_refused_with_what_to_install(monkeypatch, tmp_path, installed, said):
    if installed:
        (tmp_path / "Cython.py").write_text(f"__version__ = {installed!r}")
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.setitem(sys.modules, "Cython", None)  # so that what is imported now is not there afterwards
    monkeypatch.delitem(sys.modules, "Cython")
    with pytest.raises(SystemExit, match=f"{said}: with that Python, pip install --user 'Cython>=3.2,<3.3'"):
        environment.refuse_old_cython()


def test_no_cxx_compiler_is_needed_where_tf2_msgs_is_sourced(tmp_path, prefix):
    (tmp_path / "gcc").touch(mode=0o755)
    only_c = {**sourced(prefix("jazzy", "rclpy", "tf2_msgs")), "PATH": str(tmp_path), "CC": "gcc -pthread"}
    assert environment.missing_tools(only_c) == []


@pytest.fixture
def with_rcl(prefix):
    """A sourced ROS 2 with the headers and libraries of rcl."""
    root = Path(prefix("jazzy", "rclpy"))
    for file in (
        "include/rcl/rcl/rcl.h",
        "include/python3.12/Python.h",
        "lib/librcl.so",
        "lib/librcutils.so",
    ):
        (root / file).parent.mkdir(parents=True, exist_ok=True)
        (root / file).touch()
    return root


def test_the_receiver_is_made_with_the_headers_of_ros_packages_alone(with_rcl):
    ext = Extension(receiver.NAMES[0], [])
    assert receiver.complete(ext, sourced(str(with_rcl))) is None
    assert ext.include_dirs == [str(with_rcl / "include" / "rcl")]
    assert ext.library_dirs == [str(with_rcl / "lib")]


@pytest.mark.parametrize("file", ["include/rcl/rcl/rcl.h", "lib/librcl.so", "lib/librcutils.so"])
def test_the_receiver_is_left_out_with_a_notice_where_rcl_is_lacking(monkeypatch, caplog, with_rcl, file):
    (with_rcl / file).unlink()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(with_rcl))
    others = Extension("tf2_py._tf2_py", [])
    command = extensions.BuildExtensions(Distribution())
    command.extensions = [*(Extension(name, []) for name in receiver.NAMES), others]
    command.complete_receiver()
    assert command.extensions == [others]
    assert f"{with_rcl} has no {file}" in caplog.text


def test_the_receiver_uses_the_libraries_that_rclpy_has_loaded():
    program = (
        "import tf2_ros, tf2_ros._receive.loop\n"
        "loaded = {line.split()[-1] for line in open('/proc/self/maps') if '/librcl.so' in line}\n"
        "assert len(loaded) == 1, loaded"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_an_old_python_is_refused_before_setuptools_is_asked(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 18, "final", 0))
    monkeypatch.setitem(sys.modules, "setuptools", None)
    with pytest.raises(SystemExit, match="needs Python 3.10 or newer, and this is 3.9"):
        _spec.loader.exec_module(importlib.util.module_from_spec(_spec))


def test_numpy_is_all_that_an_install_without_extras_needs():
    requirements = importlib.metadata.requires("tf2-ros-cython")
    assert [text for text in requirements if "extra ==" not in text] == ["numpy>=1.21"]
    assert {"ros", "ros-kilted", "test", "bench", "dev"} <= set(
        importlib.metadata.metadata("tf2-ros-cython").get_all("Provides-Extra")
    )


def test_dev_extra_holds_what_the_build_requires():
    """`make build` runs without isolation, so that the two lists must not drift apart."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    required = re.findall(r'"([^";]+); python_version', text.split("[project]")[0])
    [dev] = re.findall(r"^dev = \[(.*)\]", text, re.MULTILINE)
    assert required
    assert set(required) <= set(re.findall(r'"([^"]+)"', dev))


def test_source_distribution_holds_what_a_build_needs(monkeypatch, tmp_path):
    project = checkout_copy(tmp_path / "project")
    monkeypatch.chdir(project)
    archive = build_backend.build_sdist(str(tmp_path))
    with tarfile.open(tmp_path / archive) as opened:
        held = {name.partition("/")[2] for name in opened.getnames()}
    files = [path for folder in ("tf2_*", "build_backend") for path in project.glob(f"{folder}/**/*")]
    sources = {str(path.relative_to(project)) for path in files if path.is_file()}
    assert sources | {"setup.py", "setup.cfg", "pyproject.toml", "LICENSE"} <= held
    assert {"package.xml", "resource/tf2_ros_cython"} <= held
    assert not [name for name in held if name.endswith((".so", ".c", ".cpp"))]


def test_wheel_holds_nothing_that_an_earlier_build_left(tmp_path, prefix):
    """Above all no tf2_msgs, where a ROS 2 that has it was sourced since."""
    project = checkout_copy(tmp_path / "project")
    for source in project.glob("tf2_*/**/*.pyx"):
        source.unlink()  # compiling them takes long and decides nothing here
    for left in ("tf2_msgs/__init__.py", "tf2_py/gone.py"):
        (project / "build" / "lib" / left).parent.mkdir(parents=True, exist_ok=True)
        (project / "build" / "lib" / left).touch()
    program = f"import build_backend; build_backend.build_wheel({str(tmp_path)!r})"
    ros = {**os.environ, **sourced(prefix("jazzy", "rclpy", "tf2_msgs"))}
    subprocess.run([sys.executable, "-c", program], cwd=project, env=ros, check=True)
    [wheel] = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as opened:
        held = opened.namelist()
    assert "tf2_py/__init__.py" in held
    assert "tf2_py/gone.py" not in held
    assert not [name for name in held if name.startswith("tf2_msgs")]


@pytest.fixture
def chosen():
    """Chooses as `pip install -C` does."""
    yield environment.choose
    environment.choose(None)


def test_without_ros_neither_tf2_msgs_nor_the_receiver_is_built(chosen):
    chosen({"ros": "none"})
    assert not environment.must_build_tf2_msgs({})
    assert environment.ros_prefixes({}) == []
    assert "-C ros=none" in receiver.complete(Extension(receiver.NAMES[0], []), {})


def test_an_unknown_choice_of_ros_is_refused_with_the_known_ones(chosen):
    with pytest.raises(SystemExit, match="no -C ros=humble: give one of jazzy, kilted, none"):
        chosen({"ros": "humble"})


def test_a_choice_that_is_not_the_sourced_ros_is_refused(monkeypatch, chosen, with_rcl):
    manifest = with_rcl / "share" / "rclpy" / "package.xml"
    manifest.parent.mkdir()
    manifest.write_text("<version>7.1.9</version>")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(with_rcl))
    chosen({"ros": "jazzy"})
    with pytest.raises(SystemExit, match="built for kilted where a ROS 2 with rclpy 7.1.9 is sourced"):
        chosen({"ros": "kilted"})


@pytest.mark.parametrize(("version", "name"), [("7.1.5", "jazzy"), ("9.1.2", "kilted"), ("10.0.1", "jazzy")])
def test_the_wheels_are_those_of_the_distribution_that_is_installed(monkeypatch, tmp_path, version, name):
    """Build isolation hides the packages, and not the folder in which they lie."""
    manifest = tmp_path / "share" / "rclpy" / "package.xml"
    manifest.parent.mkdir(parents=True)
    manifest.write_text(f"<version>{version}</version>")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert environment.ros_wheels() == [f"ros-{name}-rclpy[fastrtps]", f"ros-{name}-common-interfaces"]


def test_tf2_msgs_of_a_checkout_hands_over_to_the_sourced_one(tmp_path):
    checkout_copy(tmp_path / "project")
    theirs = tmp_path / "ros" / "tf2_msgs" / "msg"
    theirs.mkdir(parents=True)
    (theirs.parent / "__init__.py").touch()
    (theirs / "__init__.py").write_text("TFMessage = 'theirs'")
    program = "from tf2_msgs.msg import TFMessage; assert TFMessage == 'theirs', TFMessage"
    subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path / "project",
        env={**os.environ, "PYTHONPATH": str(tmp_path / "ros")},
        check=True,
    )


@pytest.mark.parametrize("package", ["tf2_py", "tf2_ros", "tf2_geometry_msgs", "tf2_sensor_msgs"])
def test_a_checkout_that_is_not_built_says_what_to_do(tmp_path, package):
    project = checkout_copy(tmp_path / "project")
    ended = subprocess.run(
        [sys.executable, "-c", f"import {package}"], cwd=project, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    [error] = [line for line in ended.stderr.splitlines() if line.startswith("ModuleNotFoundError: tf2_py.")]
    assert f" is missing: {project} is not built for Python " in error
    assert "`make build` there" in error and "cd elsewhere" in error
    assert "During handling" not in ended.stderr


def test_a_checkout_that_is_not_built_and_hides_an_installation_says_so_in_both_checks(tmp_path):
    project = checkout_copy(tmp_path / "project")
    installed = tmp_path / "installed" / "tf2_py"
    installed.mkdir(parents=True)
    (installed / "__init__.py").touch()
    hint = f", and hides the tf2_py in {installed.parent}. cd elsewhere, or run `make build` there"
    for module in ("tf2_ros.cli.which", "tf2_ros_cython"):
        ended = subprocess.run(
            [sys.executable, "-m", module],
            cwd=project,
            env={**os.environ, "PYTHONPATH": str(installed.parent)},
            capture_output=True,
            text=True,
        )
        assert ended.returncode == 1
        assert hint in ended.stdout + ended.stderr


def test_a_library_that_is_missing_is_not_called_a_missing_build(tmp_path):
    folder = tmp_path / "tf2_py"
    folder.mkdir()
    (folder / "__init__.py").write_text((ROOT / "tf2_py" / "__init__.py").read_text(encoding="utf-8"))
    (folder / "_tf2_py.py").write_text("import surely_not_installed")
    ended = subprocess.run(
        [sys.executable, "-c", "import tf2_py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ended.stderr.splitlines()[-1] == "ModuleNotFoundError: No module named 'surely_not_installed'"
