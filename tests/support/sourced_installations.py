# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A ROS 2 to source, and installations where it is sourced: Pythons with ours, workspaces of colcon."""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import installing
from installing import OURS, PACKAGES, SITE
from processes import run

INDEX = Path("share", "ament_index", "resource_index", "packages")
# Prints whose each package is.
OWNERS = f"""
import importlib
for name in {(*OURS, "tf2_msgs")}:
    package = importlib.import_module(name)
    print(name, getattr(package, "OWNER", package.__path__[0]))
"""


class Prefix:
    """A folder that AMENT_PREFIX_PATH may name, with Python packages and their markers."""

    def __init__(self, path):
        self.path = Path(path)
        (self.path / SITE).mkdir(parents=True)
        (self.path / INDEX).mkdir(parents=True)

    def mark(self, *packages):
        for package in packages:
            (self.path / INDEX / package).touch()
        return self

    def add_stubs(self, owner, *packages):
        """Packages that say whose they are."""
        for package in packages:
            folder = self.path / SITE / package
            folder.mkdir()
            (folder / "__init__.py").write_text(f"OWNER = {owner!r}\n")
        return self.mark(*packages)


def distribution(path):
    """A ROS 2 made of the wheels of this environment, which hold no tf2."""
    prefix = Prefix(path)
    installed = Path(sysconfig.get_path("purelib"))
    for entry in installed.iterdir():
        ours = entry.name.startswith(("tf2_", "__editable__", "ros_wheels_bootstrapper"))
        if not ours and entry.suffix != ".pth":
            (prefix.path / SITE / entry.name).symlink_to(entry)
    for library in Path(sys.prefix, "lib").glob("lib*.so*"):
        (prefix.path / "lib" / library.name).symlink_to(library)
    (prefix.path / "include").symlink_to(Path(sys.prefix, "include"))
    for package in Path(sys.prefix, "share").iterdir():
        if package.name not in ("ament_index", "tf2_ros_cython"):
            (prefix.path / "share" / package.name).symlink_to(package)
    return prefix.mark(
        *(marker.name for marker in Path(sys.prefix, INDEX).iterdir() if "tf2" not in marker.name)
    )


def copy_messages(folder, *left_out):
    """The tf2_msgs of this environment, copied into a folder."""
    [source] = importlib.util.find_spec("tf2_msgs").submodule_search_locations
    shutil.copytree(source, folder / "tf2_msgs", ignore=shutil.ignore_patterns("__pycache__", *left_out))


def sourced(*prefixes, **more):
    """The environment of a shell that sourced these prefixes, the overlay first."""
    environment = installing.unsourced()
    environment["AMENT_PREFIX_PATH"] = os.pathsep.join(str(prefix.path) for prefix in prefixes)
    environment["PYTHONPATH"] = os.pathsep.join(str(prefix.path / SITE) for prefix in prefixes)
    libraries = [prefix.path / "lib" for prefix in prefixes]
    libraries += [folder for prefix in prefixes for folder in (prefix.path / SITE).glob("ros_*.libs")]
    environment["LD_LIBRARY_PATH"] = os.pathsep.join(map(str, libraries))
    return {**environment, **more}


def distribution_with_tf2(path):
    """A distribution with a tf2 of its own."""
    prefix = distribution(path).add_stubs("distribution", *OURS)
    copy_messages(prefix.path / SITE, "_release.py")
    return prefix.mark("tf2_msgs")


def add_tf2_ros_py(checkout):
    """Put a package of tf2's own Python packages beside a checkout in a workspace."""
    folder = checkout.with_name("tf2_ros_py")
    for name in OURS:
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text("OWNER = 'workspace'\n")
    (folder / "package.xml").write_text(
        "<package format='3'><name>tf2_ros_py</name><version>1.0.0</version>"
        "<description/><license>BSD</license>"
        "<maintainer email='tests@example.org'>tests</maintainer>"
        "<export><build_type>ament_python</build_type></export></package>"
    )
    (folder / "tf2_ros_py").touch()
    (folder / "setup.py").write_text(
        "from setuptools import setup\n"
        f"setup(name='tf2_ros_py', version='1.0.0', packages={list(OURS)}, data_files=["
        "('share/ament_index/resource_index/packages', ['tf2_ros_py']), "
        "('share/tf2_ros_py', ['package.xml'])])\n"
    )


class Installation:
    """A Python that ours is installed into, what its environment has to say for that, and where ours lies."""

    def __init__(self, python, home, **environment):
        self.python, self.home, self.environment = python, home, environment

    def run(self, environment, *arguments):
        # In a folder that holds none of ours.
        return run(self.python, *arguments, env={**environment, **self.environment}, cwd=self.python.parent)

    def owners(self, environment):
        ended = self.run(environment, "-c", OWNERS)
        assert ended.returncode == 0, ended.stderr
        found = dict(line.split() for line in ended.stdout.splitlines())
        homes = {str(self.home / name): "ours" for name in found}
        return {name: homes.get(where, where) for name, where in found.items()}


class Workspace(Installation):
    """A workspace built by colcon, and a Python without ours that starts where it is sourced."""

    def __init__(self, path, ros, *options, packages=None):
        """:param packages: called with the folder of the checkout, to put more beside it."""
        self.path, is_merged = path, "--merge-install" in options
        self.prefix = path / "install" if is_merged else path / "install" / "tf2_ros_cython"
        self.source, build = path / "src" / "tf2-ros-cython", path / "build" / "tf2_ros_cython"
        installing.checkout_copy(self.source)
        installing.reuse_builds(build)
        if packages is not None:
            packages(self.source)
        colcon = Path(sysconfig.get_path("scripts"), "colcon")
        environment = installing.unoptimised(path, sourced(ros))
        subprocess.run([colcon, "build", *options], cwd=path, env=environment, check=True)
        home = build if "--symlink-install" in options else self.prefix / PACKAGES
        super().__init__(installing.new_venv(path / "venv"), home)

    def run(self, environment, *arguments):
        return self.start(environment, self.python, *arguments)

    def start(self, environment, *command):
        shell = 'source "$0"/install/setup.bash && cd / && exec "$@"'
        return run("bash", "-c", shell, self.path, *command, env=environment)
