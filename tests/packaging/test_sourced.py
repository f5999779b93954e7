"""Where a ROS 2 is sourced: which tf2 a program imports, from each kind of install, and what it is told."""

import os
import shutil
import sys
import zipfile
from pathlib import Path

import installing
import numpy
import pytest
from installing import INDEX, OURS, SITE, Prefix, sourced, unsourced
from sources import PYPROJECT
from workspaces import Installation, Workspace, distribution_with_tf2

pytestmark = [
    pytest.mark.ours,
    pytest.mark.long("builds and installs the project"),
    pytest.mark.timeout(1200),
    pytest.mark.skipif("AMENT_PREFIX_PATH" in os.environ, reason="the ROS 2 to source is made of the wheels"),
]

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
    return Installation(python, made / "venv" / SITE)


@pytest.fixture(scope="module")
def of_user(made, wheel):
    python, base = Path(sys._base_executable), str(made / "user")
    installing.pip_install(python, wheel, "--user", "--break-system-packages", PYTHONUSERBASE=base)
    return Installation(python, made / "user" / SITE, PYTHONUSERBASE=base)


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


def each_of(*names):
    """A fixture that is each of these."""
    return pytest.fixture(params=names)(lambda request: request.getfixturevalue(request.param))


installation = each_of("in_venv", "of_user", "editable")
workspace = each_of("colcon", "linked")
anywhere = each_of("in_venv", "of_user", "editable", "colcon", "linked")


def all_of(owner, **others):
    return {**dict.fromkeys(OURS, owner), **others}


def messages_of(prefix):
    return str(prefix.path / SITE / "tf2_msgs")


def test_ours_precedes_the_distributions_but_for_the_messages(anywhere, ros):
    assert anywhere.owners(sourced(ros)) == all_of("ours", tf2_msgs=messages_of(ros))


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
    assert loaded == ["tf2_ros_cython", "tf2_ros_cython._finder"]


@pytest.mark.parametrize(
    ("forked", "others", "expected"),
    [
        ("tf2_py", [], all_of("distribution", tf2_py="fork")),
        ("tf2_ros", [], all_of("distribution", tf2_ros="fork", tf2_py="ours")),
        ("tf2_geometry_msgs", [], all_of("ours", tf2_geometry_msgs="fork", tf2_sensor_msgs="distribution")),
        ("tf2_sensor_msgs", [], all_of("ours", tf2_sensor_msgs="fork")),
        ("tf2_sensor_msgs", ["rclpy"], all_of("ours", tf2_sensor_msgs="fork")),  # still no distribution
    ],
)
def test_a_workspaces_fork_stays_with_what_stands_on_it(in_venv, ros, tmp_path, forked, others, expected):
    overlay = Prefix(tmp_path / "overlay").mark(*others).add_stubs("fork", forked)
    found = in_venv.owners(sourced(overlay, ros))
    assert found == {**expected, "tf2_msgs": messages_of(ros)}


def test_a_distribution_may_have_a_folder_for_each_package(in_venv, ros, tmp_path):
    """As colcon builds it from source."""
    (tmp_path / ".colcon_install_layout").write_text("isolated\n")
    with_rclpy = Prefix(tmp_path / "rclpy").mark("rclpy")
    with_tf2 = [Prefix(tmp_path / name).add_stubs("distribution", name) for name in OURS]
    environment = sourced(*with_tf2, with_rclpy, ros)
    environment["AMENT_PREFIX_PATH"] = environment["AMENT_PREFIX_PATH"].removesuffix(f":{ros.path}")
    assert in_venv.owners(environment) == all_of("ours", tf2_msgs=messages_of(ros))


def test_a_python_whose_checkout_is_gone_starts_in_silence(editable, made, ros):
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
            assert lines[place + 1] == f"    takes precedence over {ros.path / SITE / name}"
        assert f"tf2_msgs: the environment's, {messages_of(ros)}" in lines
        assert "receiver: in use; listeners need no executor" in lines
        assert any(line.startswith("ROS 2: Jazzy (rclpy 7.") for line in lines)

    @pytest.mark.parametrize(
        ("variable", "reason"),
        [({}, "a workspace or a folder of your own"), ({"TF2_ROS_CYTHON": "0"}, "TF2_ROS_CYTHON=0 is set")],
    )
    def test_it_tells_why_another_is_imported(self, in_venv, ros, tmp_path, variable, reason):
        overlay = Prefix(tmp_path / "overlay").add_stubs("fork", *([] if variable else ["tf2_ros"]))
        ended = in_venv.run(sourced(overlay, ros, **variable), "-m", "tf2_ros_cython")
        assert ended.returncode == 1
        [line] = [line for line in ended.stdout.splitlines() if line.startswith("tf2_ros: ")]
        assert line.startswith("tf2_ros: not tf2-ros-cython, ")
        assert reason in line

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


def kilted(path, ros):
    """What is known of Kilted: the versions of its rclpy and type support, in the place of the others."""
    prefix = Prefix(path).mark("rclpy")
    shutil.copytree(ros.path / SITE, prefix.path / SITE, symlinks=True, dirs_exist_ok=True)
    rclpy = prefix.path / SITE / "rclpy"
    rclpy.unlink()  # its place decides, so it must lie in there
    rclpy.mkdir()
    (rclpy / "__init__.py").touch()
    for package, version in (("rclpy", "9.1.2"), ("rosidl_typesupport_fastrtps_c", "3.8.1")):
        (prefix.path / "share" / package).mkdir()
        (prefix.path / "share" / package / "package.xml").write_text(f"<version>{version}</version>")
    shutil.rmtree(prefix.path / SITE / "tf2_msgs")
    return prefix


def test_messages_of_another_release_or_none_are_refused_with_what_to_install(in_venv, ros, tmp_path):
    environment = sourced(kilted(tmp_path / "kilted", ros))
    said = in_venv.run(environment, "-c", "import tf2_ros").stderr
    assert "ModuleNotFoundError: tf2_ros needs tf2_msgs, which the ROS 2 Kilted (rclpy 9.1.2) in " in said
    assert "apt install ros-kilted-tf2-msgs" in said
    installing.copy_messages(tmp_path / "messages")
    environment["PYTHONPATH"] += f"{os.pathsep}{tmp_path / 'messages'}"
    refused = in_venv.run(environment, "-c", "import tf2_ros").stderr
    assert f"ImportError: the tf2_msgs in {tmp_path / 'messages' / 'tf2_msgs'} is made for" in refused
    assert f"but this is ROS 2 Kilted (rclpy 9.1.2) in {tmp_path / 'kilted'}, with 3.8" in refused
    for one in (said, refused):
        assert "in a clone of tf2-ros-cython, pip install ./messages -C ros=kilted" in one


def test_the_wheel_holds_no_debug_information(wheel):
    with zipfile.ZipFile(wheel) as opened:
        extensions = [name for name in opened.namelist() if name.endswith(".so")]
        assert extensions
        assert not [name for name in extensions if b".debug_info" in opened.read(name)]
