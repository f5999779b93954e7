"""What gets installed, which is the same wherever it is built; and what a refusal says."""

import importlib
import importlib.metadata
import importlib.util
import os
import subprocess
import sys
import tarfile
import zipfile

import pytest
from installing import Prefix, backend_at, checkout_copy, sourced, unsourced
from paths import ROOT
from processes import run

# By its place and not by the path: the path must not make the checkout's packages importable.
build_backend = backend_at(ROOT / "build_backend", "build_backend")
environment = build_backend.environment


@pytest.fixture(autouse=True)
def path_of_its_own(monkeypatch):
    """The build runs setup.py in this process, which adds its folder; children of later tests inherit it."""
    monkeypatch.setattr(sys, "path", sys.path[:])


def test_missing_compilers_are_named_with_what_to_install(tmp_path):
    with pytest.raises(SystemExit, match=r"no C compiler .*install gcc"):
        environment.refuse_incomplete({"PATH": str(tmp_path)})


@pytest.mark.parametrize(
    ("installed", "said"), [("3.1.8", "has 3.1.8"), ("3.3.0", "has 3.3.0"), (None, "has none")]
)
def test_another_cython_is_refused_with_what_to_install(monkeypatch, tmp_path, installed, said):
    if installed:
        (tmp_path / "Cython.py").write_text(f"__version__ = {installed!r}")
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.setitem(sys.modules, "Cython", None)  # so that what is imported now is not there afterwards
    monkeypatch.delitem(sys.modules, "Cython")
    with pytest.raises(SystemExit, match=f"{said}: with that Python, pip install --user 'Cython>=3.2,<3.3'"):
        environment.refuse_other_cython()


def test_an_old_python_is_refused_before_setuptools_is_asked(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 18, "final", 0))
    monkeypatch.setitem(sys.modules, "setuptools", None)
    with pytest.raises(SystemExit, match="needs Python 3.10 or newer, and this is 3.9"):
        backend_at(ROOT / "build_backend", "build_backend_of_an_old_python")


def test_numpy_is_all_that_an_install_without_extras_needs():
    requirements = importlib.metadata.requires("tf2-ros-cython")
    assert [text for text in requirements if "extra ==" not in text] == ["numpy>=1.21"]
    assert {"ros", "ros-kilted", "test", "dev"} <= set(
        importlib.metadata.metadata("tf2-ros-cython").get_all("Provides-Extra")
    )


def test_source_distribution_holds_what_a_build_needs(monkeypatch, tmp_path):
    project = checkout_copy(tmp_path / "project")
    monkeypatch.chdir(project)
    archive = build_backend.build_sdist(str(tmp_path))
    with tarfile.open(tmp_path / archive) as opened:
        held = {name.partition("/")[2] for name in opened.getnames()}
    files = [path for folder in ("tf2_*", "build_backend") for path in project.glob(f"{folder}/**/*")]
    files += project.glob("messages/**/*")
    sources = {str(path.relative_to(project)) for path in files if path.is_file()}
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
        (tmp_path / name).mkdir()
        hook = f"build_wheel({str(tmp_path / name)!r}, {{'ros': 'kilted'}})"
        program = f"import build_backend; build_backend.{hook}"
        subprocess.run([sys.executable, "-c", program], cwd=project, env=ros, check=True)
        [wheel] = (tmp_path / name).glob("*.whl")
        with zipfile.ZipFile(wheel) as opened:
            held.append({entry: opened.read(entry) for entry in opened.namelist()})
    assert held[0] == held[1] == held[2]
    assert "tf2_py/__init__.py" in held[0]
    assert "tf2_py/gone.py" not in held[0]
    assert not [name for name in held[0] if name.startswith("tf2_msgs")]


def without_editable_installs(folder):
    """The environment of a Python that does not find this checkout's extensions for another one."""
    kept = "[one for one in sys.meta_path if 'editable' not in getattr(one, '__module__', '')]"
    (folder / "sitecustomize.py").write_text(f"import sys\nsys.meta_path[:] = {kept}\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


@pytest.mark.parametrize("package", ["tf2_py", "tf2_ros", "tf2_geometry_msgs", "tf2_sensor_msgs"])
def test_a_checkout_that_is_not_built_says_what_to_do(tmp_path, package):
    project = checkout_copy(tmp_path / "project")
    environment = without_editable_installs(tmp_path)
    ended = run(sys.executable, "-c", f"import {package}", cwd=project, env=environment)
    assert ended.returncode == 1
    [error] = [line for line in ended.stderr.splitlines() if line.startswith("ModuleNotFoundError: tf2_py.")]
    assert f" is missing: {project} is not built for Python " in error
    assert "`make build` there" in error and "cd elsewhere" in error
    assert "During handling" not in ended.stderr
