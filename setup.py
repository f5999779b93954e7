# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What pyproject.toml cannot express: packages and extensions, found by their sources."""

import sys
from pathlib import Path

import setuptools
from setuptools import setup

try:
    import setuptools.config.pyprojecttoml
except ModuleNotFoundError:
    # The number of the version does not tell: in a build by pip 26.2, setuptools has that of this project.
    # Not SystemExit, which colcon ignores.
    raise RuntimeError(
        f"tf2-ros-cython cannot be built with setuptools {setuptools.__version__}, which does not read"
        " [project] in pyproject.toml. The colcon of Ubuntu 22.04 uses that one: run pip install in a virtual"
        " environment instead, as docs/switching.md describes"
    ) from None

if "--editable" in sys.argv:
    from setuptools.command.develop import develop

    if not any(name == "editable" for name, *_ in develop.user_options):
        raise RuntimeError(
            f"colcon build --symlink-install does not work with setuptools {setuptools.__version__} and this"
            " colcon-core: update colcon-core to 0.21 or newer, or build without --symlink-install"
        )

ROOT = Path(__file__).resolve().parent
# setuptools runs this file without its folder on the path.
sys.path.insert(0, str(ROOT))

from build_backend import extensions, install_command  # noqa: E402

# `colcon build --symlink-install` runs this file in a folder of its own, with links to the packages alone.
for name in ("pyproject.toml", "README.md", "LICENSE"):
    if not Path(name).exists():
        Path(name).symlink_to(ROOT / name)

packages = extensions.packages(ROOT)
data = {name: ["*.pxd", "*/*_header.pxi", "*.pyi", "py.typed"] for name in packages}

setup(
    # Here for colcon's sake: requires-python of pyproject.toml becomes an object that it cannot read, and the
    # setuptools of Ubuntu 24.04 takes a license from there only in a form that newer ones drop.
    python_requires=">=3.10",
    license="BSD-3-Clause",
    license_files=["LICENSE"],
    packages=packages,
    package_data=data,
    include_package_data=False,
    # By these the tools of ROS find the package.
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tf2_ros_cython"]),
        (
            "share/ament_index/resource_index/package_run_dependencies",
            ["resource/package_run_dependencies/tf2_ros_cython"],
        ),
        ("share/tf2_ros_cython", ["package.xml", "resource/package.dsv"]),
        ("share/tf2_ros_cython/hook", ["resource/packages_on_pythonpath.sh"]),
    ],
    ext_modules=extensions.cython_extensions(ROOT),
    cmdclass={"build_ext": extensions.BuildExtensions, "install_lib": install_command.InstallLib},
    zip_safe=False,
)
