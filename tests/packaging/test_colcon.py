"""A workspace built by colcon over a ROS 2 made of the wheels: what it holds, and what it makes imported."""

import os
import subprocess
import sysconfig
from pathlib import Path

import installing
import pytest
from installing import INDEX, OURS, SITE
from processes import run
from sources import PYPROJECT

pytestmark = [
    pytest.mark.ours,
    pytest.mark.long("builds the project with colcon, twice"),
    pytest.mark.timeout(1200),
    pytest.mark.skipif("AMENT_PREFIX_PATH" in os.environ, reason="the ROS 2 to source is made of the wheels"),
]

PROGRAMS = sorted(PYPROJECT["project"]["scripts"])


class Workspace:
    def __init__(self, path, ros, *options):
        self.path = path
        self.source = installing.checkout_copy(path / "src" / "tf2-ros-cython")
        self.build = path / "build" / "tf2_ros_cython"
        self.prefix = path / "install" / "tf2_ros_cython"
        self.environment = installing.sourced(ros)
        installing.reuse_builds(self.build)
        colcon = Path(sysconfig.get_path("scripts"), "colcon")
        subprocess.run([colcon, "build", *options], cwd=path, env=self.environment, check=True)

    def sourced(self, python, *arguments):
        """Run a Python that ours is not installed into, in a shell that has sourced the workspace."""
        shell = 'source "$0"/install/setup.bash && cd / && exec "$@"'
        ended = run("bash", "-c", shell, self.path, python, *arguments, env=self.environment)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return tmp_path_factory.mktemp("made")


@pytest.fixture(scope="module")
def ros(made):
    return installing.add_tf2(installing.distribution(made / "ros"))


@pytest.fixture(scope="module")
def python(made):
    return installing.new_venv(made / "venv")


@pytest.fixture(scope="module")
def installed(made, ros):
    return Workspace(made / "installed", ros)


@pytest.fixture(scope="module")
def linked(made, ros):
    return Workspace(made / "linked", ros, "--symlink-install")


@pytest.fixture(params=["installed", "linked"])
def workspace(request):
    return request.getfixturevalue(request.param)


def test_one_package_is_built_and_it_has_none_of_tf2s_names(workspace):
    folders = [path.name for path in (workspace.path / "install").iterdir() if path.is_dir()]
    assert folders == ["tf2_ros_cython"]
    assert [marker.name for marker in (workspace.prefix / INDEX).iterdir()] == ["tf2_ros_cython"]
    assert (workspace.prefix / "share" / "tf2_ros_cython" / "package.xml").is_file()


def test_ours_is_imported_after_it_is_sourced(workspace, python, ros):
    lines = workspace.sourced(python, "-m", "tf2_ros_cython").splitlines()
    for name in OURS:
        [place] = [i for i, line in enumerate(lines) if line.startswith(f"{name}: tf2-ros-cython, ")]
        assert lines[place + 1] == f"    takes precedence over {ros.path / SITE / name}"
    assert "receiver: in use; listeners need no executor" in lines


def test_its_programs_are_where_ros2_run_looks(workspace, python):
    program = "from ament_index_python import get_package_prefix; print(get_package_prefix('tf2_ros_cython'))"
    prefix = Path(workspace.sourced(python, "-c", program).strip())
    programs = prefix / "lib" / "tf2_ros_cython"
    assert sorted(path.name for path in programs.iterdir()) == PROGRAMS
    assert all(os.access(path, os.X_OK) for path in programs.iterdir())
    assert workspace.sourced(programs / "tf2_which").startswith("tf2_py: tf2-ros-cython, ")
    assert workspace.sourced(programs / "tf2_echo", "-h").startswith("usage: tf2_echo ")


def test_links_lead_to_the_sources(linked, python):
    place = linked.sourced(python, "-c", "import tf2_ros; print(tf2_ros.__file__)").strip()
    assert Path(place).resolve() == (linked.source / "tf2_ros" / "__init__.py").resolve()
