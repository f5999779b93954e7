"""The project of tf2_msgs: for which release it is built, what it is called, and where it is refused."""

import email
import importlib
import importlib.metadata
import importlib.util
import os
import sys
import tarfile

import pytest
from installing import backend_at, messages_copy
from packaging.requirements import Requirement
from paths import ROOT
from processes import output_of

pytestmark = pytest.mark.ours

# By its place: a folder `backend` on the path may be anybody's.
backend = backend_at(ROOT / "messages" / "backend", "messages_backend")
environment = backend.environment


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    monkeypatch.setenv("_TF2_MSGS_RELEASE", "")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def call(hook, project, target, settings):
    """One of the build's hooks, as pip calls it."""
    target.mkdir()
    program = f"import backend; print(backend.{hook}({str(target)!r}, {settings!r}))"
    return output_of("-c", program, cwd=project).split()[-1]


@pytest.mark.parametrize("release", ["jazzy", "kilted"])
def test_name_and_requirements_are_those_of_the_release(tmp_path, release):
    project = messages_copy(tmp_path / "project")
    folder = call("prepare_metadata_for_build_wheel", project, tmp_path / "made", {"ros": release})
    metadata = email.message_from_string((tmp_path / "made" / folder / "METADATA").read_text())
    assert metadata["Name"] == f"tf2-ros-cython-msgs-{release}"
    required = {text.partition("[")[0] for text in metadata.get_all("Requires-Dist")}
    assert {f"ros-{release}-rclpy", f"ros-{release}-common-interfaces"} <= required
    extra = {"jazzy": "ros", "kilted": "ros-kilted"}[release]
    [ours] = [
        Requirement(text)
        for text in importlib.metadata.requires("tf2-ros-cython")
        if text.startswith(metadata["Name"]) and f'extra == "{extra}"' in text
    ]
    assert metadata["Version"] in ours.specifier


def test_a_source_distribution_stays_with_its_release_and_holds_nothing_built(tmp_path):
    project = messages_copy(tmp_path / "project")
    made = ["_release.py", "msg/__init__.py", "srv/_frame_graph.py", "libtf2_msgs__x.so"]
    for name in made:
        (project / "src" / "tf2_msgs" / name).touch()
    archive = call("build_sdist", project, tmp_path / "made", {"ros": "kilted"})
    assert archive.startswith("tf2_ros_cython_msgs_kilted-")
    filtered = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}  # not in Debian 12's 3.11.2
    with tarfile.open(tmp_path / "made" / archive) as opened:
        opened.extractall(tmp_path / "extracted", **filtered)
    [unpacked] = (tmp_path / "extracted").iterdir()
    package = unpacked / "src" / "tf2_msgs"
    for name in ("__init__.py", "msg/TFMessage.msg", "srv/FrameGraph.srv", "package.xml", "../../LICENSE"):
        assert (package / name).is_file()
    assert not [name for name in made if (package / name).exists()]
    folder = call("prepare_metadata_for_build_wheel", unpacked, tmp_path / "again", None)
    assert folder.startswith("tf2_ros_cython_msgs_kilted-")


def test_a_release_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(SystemExit, match="tf2_msgs knows no -C ros=humble: give one of jazzy, kilted"):
        environment.choose({"ros": "humble"})


@pytest.mark.parametrize(("version", "name"), [("7.1.5", "jazzy"), ("9.1.2", "kilted"), ("10.0.1", "jazzy")])
def test_the_release_is_that_of_the_wheels_that_are_installed(monkeypatch, tmp_path, version, name):
    """Build isolation hides the packages, and not the folder in which they lie."""
    manifest = tmp_path / "share" / "rclpy" / "package.xml"
    manifest.parent.mkdir(parents=True)
    manifest.write_text(f"<version>{version}</version>")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert environment.ros_wheels() == [f"ros-{name}-rclpy[fastrtps]", f"ros-{name}-common-interfaces"]


def test_beside_a_sourced_ros_nothing_is_built(tmp_path):
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    overlay = f"{tmp_path / 'gone'}{os.pathsep}{tmp_path}"
    environment.refuse_sourced({"AMENT_PREFIX_PATH": overlay})
    (index / "rclpy").touch()
    with pytest.raises(
        SystemExit, match=r"a ROS 2 is sourced \(.*\), whose own is used: .* apt install ros-"
    ):
        environment.refuse_sourced({"AMENT_PREFIX_PATH": overlay})


def test_missing_compilers_are_named_with_what_to_install(tmp_path):
    with pytest.raises(SystemExit, match=r"no C compiler .*install gcc; no C\+\+ compiler .*install g\+\+"):
        environment.refuse_incomplete({"PATH": str(tmp_path)})
