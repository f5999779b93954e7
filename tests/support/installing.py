# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Set up installations: copies of the checkout, builds of them, Pythons and Debian systems of their own."""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from paths import ROOT
from processes import output_of

from tf2_ros_cython import _installation

OURS = _installation.PACKAGES
SITE = Path("lib", f"python{sys.version_info.major}.{sys.version_info.minor}", "site-packages")
PACKAGES = SITE / "tf2_ros_cython" / "packages"
PIP_INSTALL = ("install", "--quiet", "--no-deps", "--no-index")
BUILT = ("*.so", "*.egg-info", "__pycache__", "_built.py", "_release.py", "build")


def backend_at(folder, name):
    """The build's hooks in this folder, as a module of this name; the path stays as it is."""
    spec = importlib.util.spec_from_file_location(name, folder / "__init__.py")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def checkout_copy(target):
    """The checkout's own files, without anything built, and without what is for its developers."""
    others = (
        "tests",
        "docs",
        "bench",
        "reliability",
        "release",
        "examples",
        "messages",
        "tools",
        "dist",
        ".*",
    )
    shutil.copytree(ROOT, target, ignore=shutil.ignore_patterns(*BUILT, *others))
    messages_copy(target / "messages")
    return target


def messages_copy(target):
    """The checkout's project of tf2_msgs, without anything built."""
    shutil.copytree(ROOT / "messages", target, ignore=shutil.ignore_patterns(*BUILT))
    for kind in ("msg", "srv", "action"):
        for generated in (target / "src" / "tf2_msgs" / kind).glob("*.py"):
            generated.unlink()
    return target


def reuse_builds(project):
    """Let a copy build upon what the checkout's own builds left, which saves most of the time."""
    for folder in [ROOT / "build" / "inplace", *(ROOT / "build").glob("cython-*")]:
        if folder.is_dir():
            shutil.copytree(folder, project / "build" / folder.name)


def unoptimised(folder, environment):
    """An environment whose C compiler does not optimise, for what must load and need not be fast."""
    compiler = folder / "unoptimised-cc"
    name = sysconfig.get_config_var("CC").split()[0]
    compiler.write_text(f'#!/bin/sh\nexec {name} "$@" -O0\n')
    compiler.chmod(0o755)
    return {**environment, "CC": str(compiler)}


def build(hook, project, target, settings=None, environment=None):
    """Call one of a build's hooks, such as `backend.build_wheel`, as pip does; the path of what it made."""
    target.mkdir()
    module, _, function = hook.rpartition(".")
    program = f"import {module} as of; print(of.{function}"
    program += f"({str(target)!r}, {settings!r}))"
    return target / output_of("-c", program, cwd=project, env=environment).split()[-1]


def setup_install(project, root, prefix):
    """Run `setup.py install`, as for a Debian package of ROS; return where the prefix is."""
    command = ["setup.py", "-q", "install", "--root", str(root), "--prefix", prefix]
    output_of(*command, "--install-lib", f"{prefix}/{SITE}", cwd=project)
    return Path(root, prefix.lstrip("/"))


def unsourced():
    """The environment of a new shell."""
    left_out = ("AMENT_PREFIX_PATH", "PYTHONPATH", "TF2_ROS_CYTHON")
    return {name: value for name, value in os.environ.items() if name not in left_out}


def new_venv(path, wheel=None):
    """A virtual environment with nothing but the wheel, without what it depends on; return its Python."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", path], check=True)
    python = Path(path, "bin", "python")
    if wheel is not None:
        pip_install(python, wheel)
    return python


def pip_install(python, wheel, *options, **environment):
    command = [sys.executable, "-m", "pip", "--python", python, *PIP_INSTALL]
    subprocess.run([*command, *options, wheel], env={**unsourced(), **environment}, check=True)


def pip_uninstall(python, name):
    command = [sys.executable, "-m", "pip", "--python", python, "uninstall", "--quiet", "--yes", name]
    subprocess.run(command, env=unsourced(), check=True)


def debian_package(path, name, tree):
    """Make a .deb of a tree of files, and return its path."""
    (tree / "DEBIAN").mkdir()
    control = f"Package: {name}\nVersion: 1\nArchitecture: all\nMaintainer: tests <tests@example.org>\n"
    (tree / "DEBIAN" / "control").write_text(f"{control}Description: test\n")
    subprocess.run(["dpkg-deb", "--root-owner-group", "--build", tree, path], check=True, capture_output=True)
    return path


def debian_install(root, *packages):
    """Install .debs into a system of their own."""
    for folder in ("updates", "info", "triggers"):
        (root / "var" / "lib" / "dpkg" / folder).mkdir(parents=True, exist_ok=True)
    (root / "var" / "lib" / "dpkg" / "status").touch()
    command = ["dpkg", f"--root={root}", "--force-not-root", "--force-script-chrootless", "--install"]
    subprocess.run([*command, *packages], check=True, capture_output=True, text=True)


def link_libraries(folder, *requirements):
    """Fill a folder with the libraries of this Python that these require, directly or not."""
    folder.mkdir()
    linked = set()
    wanted = [Requirement(one) for one in requirements]
    while wanted:
        requirement = wanted.pop()
        name = (requirement.name, *sorted(requirement.extras))
        if name in linked:
            continue
        linked.add(name)
        found = metadata.distribution(requirement.name)
        for entry in {file.parts[0] for file in found.files if file.parts[0] not in ("..", "__pycache__")}:
            if not (folder / entry).exists():
                (folder / entry).symlink_to(found.locate_file(entry))
        for needed in map(Requirement, found.requires or ()):
            extras = requirement.extras or {""}
            if needed.marker is None or any(needed.marker.evaluate({"extra": one}) for one in extras):
                wanted.append(needed)
    return folder
