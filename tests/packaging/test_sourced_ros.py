# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where a ROS 2 is sourced: which tf2 a program imports, from each kind of install, and what it is told."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import installing
import numpy
import pytest
from installing import OURS, PACKAGES, SITE, unsourced
from paths import ROOT
from processes import run
from project_sources import PYPROJECT
from sourced_installations import (
    INDEX,
    OWNERS,
    Installation,
    Prefix,
    Workspace,
    add_tf2_ros_py,
    copy_messages,
    distribution,
    distribution_with_tf2,
    sourced,
)

sys.path.insert(0, str(ROOT))
from release import unpacking_debs

pytestmark = [
    pytest.mark.long("builds and installs the project"),
    pytest.mark.skipif("AMENT_PREFIX_PATH" in os.environ, reason="the ROS 2 to source is made of the wheels"),
]

NOT_MIXED = "tf2-ros-cython is not mixed with the tf2_ros of a workspace or of PYTHONPATH"
STARTED = "import sys; print(*[name for name in sys.modules if name.startswith('tf2')])"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return tmp_path_factory.mktemp("made")


@pytest.fixture(scope="module")
def wheel(made):
    """Built as for a Python whose own flags ask for debug information."""
    project = installing.checkout_copy(made / "project")
    installing.reuse_builds(project)
    flags = installing.unoptimised(made, {**os.environ, "CFLAGS": "-g"})
    return installing.build("build_backend.build_wheel", project, made / "wheel", environment=flags)


@pytest.fixture(scope="module")
def ros(made):
    return distribution_with_tf2(made / "ros")


@pytest.fixture(scope="module")
def in_venv(made, wheel):
    python = installing.new_venv(made / "venv", wheel)
    return Installation(python, made / "venv" / PACKAGES)


@pytest.fixture(scope="module")
def of_user(made, wheel):
    python, base = Path(sys._base_executable), str(made / "user")
    installing.pip_install(python, wheel, "--user", "--break-system-packages", PYTHONUSERBASE=base)
    return Installation(python, made / "user" / PACKAGES, PYTHONUSERBASE=base)


@pytest.fixture(scope="module")
def editable(made):
    checkout = installing.checkout_copy(made / "checkout")
    installing.reuse_builds(checkout)
    wheel = installing.build("build_backend.build_editable", checkout, made / "editable-wheel")
    return Installation(installing.new_venv(made / "editable", wheel), checkout)


@pytest.fixture(scope="module")
def colcon(made, ros):
    return Workspace(made / "colcon", ros)


@pytest.fixture(scope="module")
def linked(made, ros):
    return Workspace(made / "linked", ros, "--symlink-install")


@pytest.fixture(scope="module")
def merged(made, ros):
    """With tf2's own packages in the same folder."""
    return Workspace(made / "merged", ros, "--merge-install", packages=add_tf2_ros_py)


@pytest.fixture(scope="module")
def system(made, wheel):
    """What a Debian package of this project holds; `wheel` has built it."""
    return installing.setup_install(made / "project", made / "system", "/opt/ros/jazzy")


@pytest.fixture(scope="module")
def elsewhere(made, wheel):
    """The same, installed by a user into another prefix."""
    return installing.setup_install(made / "project", made / "elsewhere", "/usr/local/ros")


@pytest.fixture
def conda(tmp_path, wheel, ros):
    """ROS 2 and its tf2 in the folder of all packages of a Python, and ours, installed there by pip."""
    python = installing.new_venv(tmp_path / "conda")
    prefix = tmp_path / "conda"
    for entry in (ros.path / SITE).iterdir():
        copied = shutil.copytree if entry.name in OURS else lambda source, link: link.symlink_to(source)
        copied(entry, prefix / SITE / entry.name)
    (prefix / "share").symlink_to(ros.path / "share")
    installing.pip_install(python, wheel)
    libraries = sourced(ros)["LD_LIBRARY_PATH"]
    return Installation(python, prefix / PACKAGES, LD_LIBRARY_PATH=libraries)


def each_of(*names):
    """A fixture that is each of these."""
    return pytest.fixture(params=names)(lambda request: request.getfixturevalue(request.param))


installation = each_of("in_venv", "of_user", "editable")
workspace = each_of("colcon", "linked")
anywhere = each_of("in_venv", "of_user", "editable", "colcon", "linked", "merged")


def all_of(owner, **others):
    return {**dict.fromkeys(OURS, owner), **others}


def messages_of(prefix):
    return str(prefix.path / SITE / "tf2_msgs")


def test_ours_precedes_the_distributions_but_for_the_messages(anywhere, ros):
    assert anywhere.owners(sourced(ros)) == all_of("ours", tf2_msgs=messages_of(ros))


@pytest.mark.parametrize("is_activated", [False, True], ids=["plain", "activated"])
def test_beside_tf2_in_one_folder_ours_is_first_and_tf2_stays(conda, is_activated):
    prefix = str(conda.home.parents[4])
    environment = {**unsourced(), **({"AMENT_PREFIX_PATH": prefix} if is_activated else {})}
    messages = str(conda.home.parents[1] / "tf2_msgs")
    assert conda.owners(environment) == all_of("ours", tf2_msgs=messages)
    theirs = all_of("distribution", tf2_msgs=messages)
    assert conda.owners({**environment, "TF2_ROS_CYTHON": "0"}) == theirs
    installing.pip_uninstall(conda.python, "tf2-ros-cython")
    assert conda.owners(environment) == theirs
    assert not list(conda.home.parents[1].glob("tf2_ros_cython*"))


@pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="there are no Debian packages here")
def test_a_debian_package_is_installed_beside_that_of_tf2(system, tmp_path):
    theirs = tmp_path / "theirs"
    Prefix(theirs / "opt" / "ros" / "jazzy").add_stubs("distribution", *OURS)
    ours = shutil.copytree(system.parents[2], tmp_path / "ours")
    packages = [
        installing.debian_package(tmp_path / f"{name}.deb", name, tree)
        for name, tree in (("ros-jazzy-tf2-ros-py", theirs), ("ros-jazzy-tf2-ros-cython", ours))
    ]
    installing.debian_install(tmp_path / "root", *packages)
    site = tmp_path / "root" / "opt" / "ros" / "jazzy" / SITE
    assert (site / "tf2_ros" / "__init__.py").read_text() == "OWNER = 'distribution'\n"
    assert (site / "tf2_ros_cython" / "packages" / "tf2_ros" / "__init__.py").is_file()


BY_USER = [("elsewhere", "", "ours"), ("elsewhere", "0", "distribution"), ("elsewhere", "1", "ours")]
BY_DISTRIBUTION = [("system", "", "distribution"), ("system", "0", "distribution"), ("system", "1", "ours")]


@pytest.fixture(scope="module")
def debian(made, system):
    """A minimal Debian with a stand-in for /opt/ros, and a package of ours installed beside it."""
    if os.geteuid() != 0:
        pytest.skip("only root may chroot")
    try:
        root = unpacking_debs.unpack(made / "debian", ["bash", "python3", "python3-numpy"], "amd64")
    except (FileNotFoundError, subprocess.CalledProcessError) as error:
        pytest.skip(f"there are no Debian packages: {error}")
    if not (root / "usr" / "bin" / f"python3.{sys.version_info.minor}").exists():
        pytest.skip("Debian has another Python")
    theirs, ours = made / "debian" / "theirs", made / "debian" / "ours"
    prefix = Prefix(theirs / "opt" / "ros" / "jazzy").add_stubs("distribution", *OURS).mark("rclpy")
    (prefix.path / "setup.bash").write_text(SETUP)
    shutil.copytree(system.parents[2], ours)
    packages = [
        installing.debian_package(made / "debian" / f"{name}.deb", name, tree)
        for name, tree in (("ros-jazzy-tf2-ros-py", theirs), ("ros-jazzy-tf2-ros-cython", ours))
    ]
    installing.debian_install(root, *packages)
    return root


# What ament's setup.bash does: it sources what the packages' .dsv files name.
SETUP = f"""
export AMENT_PREFIX_PATH=/opt/ros/jazzy AMENT_CURRENT_PREFIX=/opt/ros/jazzy
export PYTHONPATH=/opt/ros/jazzy/{SITE}
for file in /opt/ros/jazzy/share/*/package.dsv; do
  IFS=';' read -r kind name < "$file"
  [ "$kind" != source ] || . "/opt/ros/jazzy/$name"
done
"""
# Where alternatives would put their links.
LIBRARIES = ":".join(f"/usr/lib/x86_64-linux-gnu/{name}" for name in ("blas", "lapack"))


@pytest.mark.parametrize(
    ("value", "file", "status"),
    [
        ("", f"/opt/ros/jazzy/{SITE}/tf2_ros/__init__.py", 1),
        ("0", f"/opt/ros/jazzy/{SITE}/tf2_ros/__init__.py", 1),
        ("1", f"/opt/ros/jazzy/{PACKAGES}/tf2_ros/__init__.py", 0),
    ],
)
def test_in_a_debian_that_has_it_programs_import_it_only_with_the_variable(debian, value, file, status):
    def started(*command):
        sourced_first = ["bash", "-c", '. /opt/ros/jazzy/setup.bash; exec "$@"', "-", *command]
        variables = {"PATH": "/usr/sbin:/usr/bin:/bin", "LD_LIBRARY_PATH": LIBRARIES, "TF2_ROS_CYTHON": value}
        return run("chroot", debian, *sourced_first, env=variables)

    imported = started("python3", "-c", "import tf2_ros; print(tf2_ros.__file__)")
    assert (imported.stdout.strip(), imported.stderr) == (file, "")
    told = started("python3", "/opt/ros/jazzy/lib/tf2_ros_cython/tf2_which")
    assert told.returncode == status, told.stdout + told.stderr


@pytest.mark.parametrize("shell", ["sh", "bash", "zsh"])
@pytest.mark.parametrize(("prefix", "value", "expected"), [*BY_USER, *BY_DISTRIBUTION])
def test_the_setup_files_of_a_prefix_put_it_first(request, ros, tmp_path, shell, prefix, value, expected):
    """Opt-out where a user has installed it; opt-in where a distribution has."""
    system = request.getfixturevalue(prefix)
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell}")
    python = installing.new_venv(tmp_path / "venv")
    hook = '. "$AMENT_CURRENT_PREFIX/share/tf2_ros_cython/hook/packages_on_pythonpath.sh"'
    script = f'{hook}; {hook}; echo "$PYTHONPATH"; exec {python} -S -c "$1"'
    environment = sourced(ros, AMENT_CURRENT_PREFIX=str(system), TF2_ROS_CYTHON=value)
    environment["PYTHONPATH"] = f"{system / SITE}{os.pathsep}{environment['PYTHONPATH']}"
    started = run(shell, "-uc", script, "-", OWNERS, env=environment, cwd="/")
    path, *lines = started.stdout.splitlines()
    assert started.returncode == 0, started.stderr
    first = [str(system / PACKAGES)] if expected == "ours" else []
    assert path.split(":") == [*first, *environment["PYTHONPATH"].split(":")]
    owners = dict(line.split() for line in lines)
    where = str(system / PACKAGES / "tf2_ros") if expected == "ours" else expected
    assert owners["tf2_ros"] == where


@pytest.mark.parametrize(("value", "status"), [("", 1), ("1", 0)])
def test_tf2_which_says_that_a_distributions_waits_for_the_variable(system, ros, tmp_path, value, status):
    python = installing.new_venv(tmp_path / "venv")
    environment = sourced(ros, AMENT_CURRENT_PREFIX=str(system), TF2_ROS_CYTHON=value)
    environment["PYTHONPATH"] = f"{system / SITE}{os.pathsep}{environment['PYTHONPATH']}"
    hook = '. "$AMENT_CURRENT_PREFIX/share/tf2_ros_cython/hook/packages_on_pythonpath.sh"'
    told = run("sh", "-c", f"{hook}; exec {python} -S -m tf2_ros_cython", env=environment, cwd="/")
    assert told.returncode == status, told.stderr
    [precedence] = [line for line in told.stdout.splitlines() if line.startswith("precedence: ")]
    if value:
        assert precedence.endswith(f"the tf2 in {ros.path}, because TF2_ROS_CYTHON=1 is set")
    else:
        assert (
            "a distribution has installed tf2-ros-cython, which then waits for TF2_ROS_CYTHON=1" in precedence
        )
        waiting = "this installation, by a distribution, waits for TF2_ROS_CYTHON=1"
        assert told.stdout.count(waiting) == len(OURS)
    late = run(python, "-S", "-m", "tf2_ros_cython", env={**environment, "TF2_ROS_CYTHON": "1"}, cwd="/")
    assert "source setup.bash again, because TF2_ROS_CYTHON=1 was not set before" in late.stdout


def test_pips_installation_is_used_although_a_distributions_waits(system, in_venv, ros):
    environment = sourced(ros)
    environment["PYTHONPATH"] = f"{system / SITE}{os.pathsep}{environment['PYTHONPATH']}"
    assert in_venv.owners(environment) == all_of("ours", tf2_msgs=messages_of(ros))


def test_pip_takes_a_distributions_for_what_the_tools_require(system, ros, tmp_path):
    python = installing.new_venv(tmp_path / "venv")
    program = "import importlib.metadata as of; print(of.version('tf2-ros-cython'))"
    environment = {**unsourced(), "PYTHONPATH": str(system / SITE)}
    assert run(python, "-c", program, env=environment).stdout.strip() == PYPROJECT["project"]["version"]


def test_the_tools_of_ros_know_what_must_be_sourced_before(system):
    marker = (system / INDEX).with_name("package_run_dependencies") / "tf2_ros_cython"
    depends = ElementTree.parse(system / "share" / "tf2_ros_cython" / "package.xml").findall("depend")
    assert marker.read_text().split(";") == [one.text for one in depends]


class TestWhereNoStartupFileIsRead:
    def test_it_tells_which_folder_the_path_lacks(self, wheel, ros, tmp_path):
        python = installing.new_venv(tmp_path / "venv")
        installing.pip_install(python, wheel, "--target", str(tmp_path / "target"))
        other = Installation(python, tmp_path / "target" / "tf2_ros_cython" / "packages")
        environment = sourced(ros)
        environment["PYTHONPATH"] += f"{os.pathsep}{tmp_path / 'target'}"
        told = other.run(environment, "-m", "tf2_ros_cython")
        assert told.returncode == 1
        assert f"; add {other.home} to PYTHONPATH" in told.stdout
        environment["PYTHONPATH"] = f"{other.home}{os.pathsep}{environment['PYTHONPATH']}"
        assert other.owners(environment) == all_of("ours", tf2_msgs=messages_of(ros))
        assert other.run(environment, "-m", "tf2_ros_cython").returncode == 0


class TestUnknownRclpy:
    def test_the_distributions_tf2_is_used_and_it_is_said_once(self, in_venv, ros, tmp_path):
        newer = rclpy_of(tmp_path / "newer", "99.1.2")
        environment = sourced(newer, ros)
        ended = in_venv.run(environment, "-c", "import tf2_ros, tf2_geometry_msgs; print(tf2_ros.OWNER)")
        assert (ended.returncode, ended.stdout) == (0, "distribution\n")
        assert ended.stderr.count("another tf2 is used, not tf2-ros-cython: ") == 1
        assert "this ROS 2 has rclpy 99.1.2" in ended.stderr
        told = in_venv.run(environment, "-m", "tf2_ros_cython")
        assert told.returncode == 1
        assert told.stdout.count("Install a newer tf2-ros-cython, or try this one with TF2_ROS_CYTHON=1") == 1
        quiet = in_venv.run({**environment, "TF2_ROS_CYTHON": "0"}, "-c", "import tf2_ros")
        assert (quiet.returncode, quiet.stderr) == (0, "")

    def test_without_another_tf2_ours_is_used_and_it_is_said_once(self, in_venv, tmp_path):
        newer = rclpy_of(tmp_path / "newer", "99.1.2")
        program = "from importlib.util import find_spec as f; print(f('tf2_py').origin, f('tf2_ros').origin)"
        ended = in_venv.run(sourced(newer), "-c", program)
        assert ended.stdout.count(str(in_venv.home)) == 2, ended.stderr
        said = "tf2-ros-cython is used, because there is no other tf2, but this ROS 2 has rclpy "
        assert ended.stderr.count(said) == 1
        assert "TF2_ROS_CYTHON=1 ends this warning" in ended.stderr

    def test_a_variable_tries_it(self, in_venv, ros, tmp_path):
        newer = rclpy_of(tmp_path / "newer", "99.1.2")
        found = in_venv.owners(sourced(newer, ros, TF2_ROS_CYTHON="1"))
        assert found == all_of("ours", tf2_msgs=messages_of(ros))

    def test_an_old_one_is_named_where_there_is_no_other_tf2(self, in_venv, ros, tmp_path):
        older = rclpy_of(tmp_path / "older", "1.0.6")
        (older.path / SITE / "rclpy").mkdir()
        (older.path / SITE / "rclpy" / "__init__.py").touch()
        refused = in_venv.run(sourced(older, ros, TF2_ROS_CYTHON="1"), "-c", "import tf2_ros")
        assert "ImportError: tf2_ros needs rclpy " in refused.stderr
        assert "this is rclpy 1.0.6 in " in refused.stderr
        alone = in_venv.run(sourced(older), "-c", "import tf2_ros")
        assert "ends this warning" not in alone.stderr
        told = in_venv.run(sourced(older, ros), "-m", "tf2_ros_cython")
        assert "this ROS 2 has rclpy 1.0.6; " in told.stdout and "Install a newer" not in told.stdout


def test_files_of_ros_may_have_any_encoding(in_venv, ros, tmp_path):
    overlay = rclpy_of(tmp_path / "overlay", "7.1.6")
    for file in ("share/rclpy/package.xml", "../.colcon_install_layout"):
        with open(overlay.path / file, "ab") as written:
            written.write("<maintainer>José</maintainer>".encode("latin-1"))
    environment = sourced(overlay, ros)
    started = in_venv.run(environment, "-c", "")
    assert (started.returncode, started.stderr) == (0, "")
    assert in_venv.owners(environment) == all_of("ours", tf2_msgs=messages_of(ros))


def rclpy_of(path, version):
    """An overlay whose rclpy has a version, and no modules."""
    prefix = Prefix(path).mark("rclpy")
    (prefix.path / "share" / "rclpy").mkdir()
    (prefix.path / "share" / "rclpy" / "package.xml").write_text(f"<version>{version}</version>")
    return prefix


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
@pytest.mark.parametrize("is_sourced", [False, True], ids=["plain", "sourced"])
def test_type_checkers_find_ours(in_venv, ros, tmp_path, checker, is_sourced):
    (tmp_path / "program.py").write_text("import tf2_ros\nreveal_type(tf2_ros.Buffer)\n")
    python = {"mypy": "--python-executable", "pyright": "--pythonpath"}[checker]
    command = [sys.executable, "-m", checker, python, in_venv.python, "program.py"]
    checked = run(*command, cwd=tmp_path, env=sourced(ros) if is_sourced else unsourced())
    assert {"mypy": "-> tf2_ros.buffer.Buffer", "pyright": '"type[Buffer]"'}[checker] in checked.stdout


def test_one_package_is_built_and_it_has_none_of_tf2s_names(workspace):
    folders = [path.name for path in (workspace.path / "install").iterdir() if path.is_dir()]
    assert folders == [marker.name for marker in (workspace.prefix / INDEX).iterdir()] == ["tf2_ros_cython"]
    assert (workspace.prefix / "share" / "tf2_ros_cython" / "package.xml").is_file()


def test_links_lead_to_the_sources(linked):
    place = Path("tf2_ros", "__init__.py")
    assert (linked.home / place).resolve() == (linked.source / place).resolve()


def test_its_programs_are_where_ros2_run_looks(workspace, ros):
    program = "from ament_index_python import get_package_prefix; print(get_package_prefix('tf2_ros_cython'))"
    prefix = Path(workspace.run(sourced(ros), "-c", program).stdout.strip())
    programs = prefix / "lib" / "tf2_ros_cython"
    assert {path.name for path in programs.iterdir()} == set(PYPROJECT["project"]["scripts"])
    assert all(os.access(path, os.X_OK) for path in programs.iterdir())
    started = workspace.start(sourced(ros), programs / "tf2_which", "-h")
    assert started.stdout.startswith("usage: tf2_which "), started.stderr


def test_a_variable_turns_it_off(installation, ros):
    off = sourced(ros, TF2_ROS_CYTHON="0")
    assert installation.owners(off) == all_of("distribution", tf2_msgs=messages_of(ros))


def test_nothing_is_loaded_at_the_start_but_where_a_ros_is_sourced(installation, ros):
    assert installation.run(unsourced(), "-c", STARTED).stdout.split() == []
    assert installation.run(sourced(ros, TF2_ROS_CYTHON="0"), "-c", STARTED).stdout.split() == []
    loaded = installation.run(sourced(ros), "-c", STARTED).stdout.split()
    finder = [] if installation.home.name == "packages" else ["tf2_ros_cython._finder"]
    assert sorted(loaded) == sorted(
        [*(f"tf2_ros_cython{one}" for one in ("", "._installation", "._startup")), *finder]
    )


@pytest.mark.parametrize("others", [[], ["rclpy"]], ids=["plain", "with_rclpy"])  # still no distribution
@pytest.mark.parametrize("forked", OURS)
def test_beside_a_workspaces_fork_none_of_ours_is_used(installation, ros, tmp_path, forked, others):
    overlay = Prefix(tmp_path / "overlay").mark(*others).add_stubs("fork", forked)
    found = installation.owners(sourced(overlay, ros))
    assert found == all_of("distribution", **{forked: "fork", "tf2_msgs": messages_of(ros)})


def test_a_folder_of_sources_is_no_fork(in_venv, ros, tmp_path):
    overlay = Prefix(tmp_path / "overlay")
    (overlay.path / SITE / "tf2_ros").mkdir(parents=True)
    (overlay.path / SITE / "tf2_ros" / "package.xml").touch()
    assert in_venv.owners(sourced(overlay, ros)) == all_of("ours", tf2_msgs=messages_of(ros))


def test_beside_a_workspaces_fork_ours_does_not_replace_what_is_missing(in_venv, ros, tmp_path):
    overlay = Prefix(tmp_path / "overlay").add_stubs("fork", "tf2_ros")
    bare = distribution(tmp_path / "bare")
    told = in_venv.run(sourced(overlay, bare), "-m", "tf2_ros_cython").stdout.splitlines()
    assert f"tf2_py: not found; {NOT_MIXED}" in told


def test_a_distribution_may_have_a_folder_for_each_package(in_venv, ros, tmp_path):
    """As colcon builds it from source."""
    (tmp_path / ".colcon_install_layout").write_text("isolated\n")
    with_rclpy = Prefix(tmp_path / "rclpy").mark("rclpy")
    with_tf2 = [Prefix(tmp_path / name).add_stubs("distribution", name) for name in OURS]
    environment = sourced(*with_tf2, with_rclpy, ros)
    environment["AMENT_PREFIX_PATH"] = environment["AMENT_PREFIX_PATH"].removesuffix(f":{ros.path}")
    assert in_venv.owners(environment) == all_of("ours", tf2_msgs=messages_of(ros))


def test_a_python_whose_checkout_is_gone_starts_in_silence(editable, made, ros):
    assert (made / "editable" / SITE / "tf2_ros_cython.pth").exists()
    hidden = editable.home.with_name("hidden")
    editable.home.rename(hidden)
    try:
        ended = editable.run(sourced(ros), "-c", "import tf2_ros; print(tf2_ros.OWNER)")
    finally:
        hidden.rename(editable.home)
    assert (ended.stdout, ended.stderr) == ("distribution\n", "")


class TestWhich:
    def test_it_tells_what_is_imported_and_before_what(self, anywhere, ros):
        ended = anywhere.run(sourced(ros), "-m", "tf2_ros_cython")
        assert ended.returncode == 0, ended.stderr
        lines = ended.stdout.splitlines()
        for name in OURS:
            place = lines.index(f"{name}: tf2-ros-cython, {anywhere.home / name}")
            # The first may be that of the same workspace.
            assert f"    takes precedence over {ros.path / SITE / name}" in lines[place + 1 : place + 3]
        assert f"tf2_msgs: from the environment, {messages_of(ros)}" in lines
        assert "receiver: in use; listeners need no executor" in lines
        assert any(line.startswith("ROS 2: Jazzy (rclpy 7.") for line in lines)

    @pytest.mark.parametrize(
        ("variable", "reason"),
        [
            ({}, "packages in a workspace or on PYTHONPATH take precedence"),
            ({"TF2_ROS_CYTHON": "0"}, "TF2_ROS_CYTHON=0 is set"),
        ],
    )
    def test_it_tells_why_another_is_imported(self, in_venv, ros, tmp_path, variable, reason):
        overlay = Prefix(tmp_path / "overlay").add_stubs("fork", *([] if variable else ["tf2_ros"]))
        ended = in_venv.run(sourced(overlay, ros, **variable), "-m", "tf2_ros_cython")
        assert ended.returncode == 1
        [line] = [line for line in ended.stdout.splitlines() if line.startswith("tf2_ros: ")]
        assert line.startswith("tf2_ros: not tf2-ros-cython, ")
        assert reason in line
        assert ended.stdout.count(NOT_MIXED) == (0 if variable else 4)  # the other three, and the precedence

    def test_without_ros_it_tells_of_another_on_the_path(self, in_venv, tmp_path):
        other = Prefix(tmp_path / "other").add_stubs("fork", "tf2_ros")
        environment = {**unsourced(), "PYTHONPATH": str(other.path / SITE)}
        ended = in_venv.run(environment, "-m", "tf2_ros_cython")
        assert ended.returncode == 1
        [line] = [line for line in ended.stdout.splitlines() if line.startswith("tf2_ros: ")]
        assert line.endswith(": packages in a workspace or on PYTHONPATH take precedence")
        assert ": tf2-ros-cython is mixed with the tf2_ros of PYTHONPATH\n" in ended.stdout

    def test_without_ros_it_is_right_if_buffers_load(self, in_venv, tmp_path):
        for entry in Path(numpy.__file__).parents[1].glob("numpy*"):
            (tmp_path / entry.name).symlink_to(entry)
        with_numpy = {**unsourced(), "PYTHONPATH": str(tmp_path)}
        ended = in_venv.run(with_numpy, "-m", "tf2_ros_cython")
        assert (ended.returncode, ended.stderr) == (0, "")
        assert "\ndoes not load: " not in ended.stdout
        assert "ROS 2: none found; buffers and recordings work without it" in ended.stdout
        assert "receiver: not in use without ROS 2" in ended.stdout
        ended = in_venv.run(with_numpy, "-c", "import tf2_ros; tf2_ros.Buffer().all_frames_as_string()")
        assert (ended.returncode, ended.stderr) == (0, "")


def of_release(path, ros, rclpy_version, type_support_version):
    """Another ROS 2: the versions of its rclpy and type support, in the place of the others."""
    prefix = Prefix(path).mark("rclpy")
    shutil.copytree(ros.path / SITE, prefix.path / SITE, symlinks=True, dirs_exist_ok=True)
    rclpy = prefix.path / SITE / "rclpy"
    rclpy.unlink()  # its place decides, so it must lie in there
    rclpy.mkdir()
    (rclpy / "__init__.py").touch()
    versions = {"rclpy": rclpy_version, "rosidl_typesupport_fastrtps_c": type_support_version}
    for package, version in versions.items():
        (prefix.path / "share" / package).mkdir()
        (prefix.path / "share" / package / "package.xml").write_text(f"<version>{version}</version>")
    shutil.rmtree(prefix.path / SITE / "tf2_msgs")
    return prefix


@pytest.mark.parametrize(
    ("name", "version", "type_support", "from_pypi"),
    [("Humble", "3.3.21", "2.2.3", False), ("Kilted", "9.1.2", "3.8.1", True)],
)
def test_messages_of_another_release_or_none_are_refused_with_what_to_install(
    in_venv, ros, tmp_path, name, version, type_support, from_pypi
):
    prefix = tmp_path / name
    environment = sourced(of_release(prefix, ros, version, type_support))
    said = in_venv.run(environment, "-c", "import tf2_ros").stderr
    lacking = (
        f"ModuleNotFoundError: tf2_ros needs tf2_msgs, which is missing in ROS 2 {name} (rclpy {version}) in "
    )
    assert lacking in said
    copy_messages(tmp_path / "messages")
    environment["PYTHONPATH"] += f"{os.pathsep}{tmp_path / 'messages'}"
    refused = in_venv.run(environment, "-c", "import tf2_ros").stderr
    assert f"ImportError: the tf2_msgs in {tmp_path / 'messages' / 'tf2_msgs'} was built for" in refused
    running = f"but this is ROS 2 {name} (rclpy {version}) in {prefix} "
    assert f"{running}(rosidl_typesupport_fastrtps_c {type_support[:3]})" in refused
    release = name.lower()
    for one in (said, refused):
        assert f"apt install ros-{release}-tf2-msgs" in one
        built = f"in a clone of tf2-ros-cython: pip install ./messages --config-settings ros={release}" in one
        assert built == from_pypi and ("./messages" in one) == from_pypi


def test_the_wheel_holds_no_debug_information(wheel):
    with zipfile.ZipFile(wheel) as opened:
        extensions = [name for name in opened.namelist() if name.endswith(".so")]
        assert extensions
        assert not [name for name in extensions if b".debug_info" in opened.read(name)]
