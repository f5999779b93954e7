# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The project of tf2_msgs: for which release it is built, what it is called, and where it is refused."""

import email
import importlib.metadata
import os
import sys
import tarfile

import pytest
from installing import backend_at, build, messages_copy
from packaging.requirements import Requirement
from paths import ROOT
from sourced_installations import Prefix

# By its place and not by the path, as in test_packaging.py.
backend = backend_at(ROOT / "messages" / "backend", "messages_backend")
messages = backend.ros_to_build_for
METADATA = "backend.prepare_metadata_for_build_wheel"


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch):
    monkeypatch.setenv("_TF2_MSGS_RELEASE", "")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def test_missing_compilers_are_named_with_what_to_install(tmp_path):
    said = r"no C compiler .*install gcc; no C\+\+ compiler .*install g\+\+"
    with pytest.raises(SystemExit, match=said):
        backend.required_tools.refuse_incomplete({"PATH": str(tmp_path)})


@pytest.mark.parametrize("release", ["jazzy", "kilted"])
def test_name_and_requirements_are_those_of_the_release(tmp_path, release):
    project = messages_copy(tmp_path / "project")
    folder = build(METADATA, project, tmp_path / "made", {"ros": release})
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
    folder = build(METADATA, unpacked, tmp_path / "again")
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
