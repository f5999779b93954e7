# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unpack packages of Debian or Ubuntu into a folder; nothing is installed."""

import shutil
import subprocess
from pathlib import Path

PROGRAMS = ("apt-get", "dpkg")


def unpack(folder, packages, architecture=None):
    """
    Unpack packages below `folder / "root"`, once, and return that folder.

    :param architecture: unpack the packages for this processor, and everything they depend on. None: only the
        packages, for this machine.
    """
    missing = [program for program in PROGRAMS if shutil.which(program) is None]
    if missing:
        raise FileNotFoundError(f"needs {' and '.join(missing)}")
    root, done = folder / "root", folder / "unpacked"
    wanted = f"{architecture} {' '.join(packages)}\n"
    if not done.exists() or done.read_text() != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        _download(folder, packages, architecture)
        for package in sorted(folder.glob("archives/*.deb")):
            _run("dpkg", "-x", package, root)
        done.write_text(wanted)
    return root


def _download(folder, packages, architecture):
    archives = folder / "archives"
    for place in (folder / "state" / "lists" / "partial", archives / "partial"):
        place.mkdir(parents=True)
    # Containers come without package lists: these are our own, and the system's stay as they are.
    options = {"Dir::State": folder / "state", "Dir::Cache": folder, "Debug::NoLocking": 1}
    if architecture is not None:
        # As if nothing were installed, so that all dependencies are downloaded.
        (folder / "status").touch()
        options |= {"Dir::State::status": folder / "status", "APT::Install-Recommends": 0}
        options |= {"APT::Architecture": architecture, "APT::Architectures::": architecture}
    apt_get = [
        "apt-get",
        "-qq",
        *(word for item in options.items() for word in ("-o", "{}={}".format(*item))),
    ]
    _run(*apt_get, "update")
    if architecture is None:
        _run(*apt_get, "download", *packages, cwd=archives)
    else:
        _run(*apt_get, "-y", "--download-only", "install", *packages)


def _run(*command, cwd: Path | None = None):
    subprocess.run([str(word) for word in command], cwd=cwd, check=True, capture_output=True, text=True)
