# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What depends on the ROS release: the distribution's name, its requirements, its one extension."""

import re
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.sdist import sdist

ROOT = Path(__file__).resolve().parent
# setuptools runs this file without its folder on the path.
sys.path.insert(0, str(ROOT))

from backend import build_command, messages_extension, ros_to_build_for  # noqa: E402

PACKAGE = ROOT / "src" / messages_extension.NAME
RELEASE = ros_to_build_for.release()
MANIFEST = (PACKAGE / "package.xml").read_text(encoding="utf-8")
VERSION = re.search(r"<version>([\d.]+)</version>", MANIFEST)
REPOSITORY = re.search(r'<url type="repository">(.+)</url>', MANIFEST)


class SourcesOfRelease(sdist):
    """Notes which release they are for."""

    def make_release_tree(self, base_dir, files):
        super().make_release_tree(base_dir, files)
        Path(base_dir, "release.txt").write_text(f"{RELEASE}\n", encoding="utf-8")


setup(
    name=f"tf2-ros-cython-msgs-{RELEASE}",
    version=VERSION.group(1),
    description=f"tf2_msgs for ROS 2 {RELEASE.capitalize()} from PyPI, whose wheels lack it",
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="tf2-ros-cython authors",
    project_urls={"Repository": REPOSITORY.group(1)},
    license="BSD-3-Clause",
    license_files=["LICENSE"],
    python_requires=">=3.10",
    install_requires=["numpy>=1.21", *ros_to_build_for.ros_wheels()],
    # A folder below: started in this one, Python finds the installed package and not the sources.
    package_dir={"": "src"},
    packages=[messages_extension.NAME],
    package_data={messages_extension.NAME: ["package.xml", "msg/*.msg", "srv/*.srv", "action/*.action"]},
    include_package_data=False,
    ext_modules=[messages_extension.MessagesExtension(PACKAGE)],
    cmdclass={"build_ext": build_command.BuildMessages, "sdist": SourcesOfRelease},
    zip_safe=False,
)
