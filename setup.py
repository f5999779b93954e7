"""Owns what pyproject.toml cannot say: packages and extensions, for which of them depends on the machine."""

import sys
from pathlib import Path

from setuptools import find_packages, setup

ROOT = Path(__file__).resolve().parent
# setuptools runs this file without its folder on the path.
sys.path.insert(0, str(ROOT))

from build_backend import environment, extensions, tf2_msgs  # noqa: E402

packages = find_packages(str(ROOT), include=["tf2_py*", "tf2_ros*", "tf2_geometry_msgs*", "tf2_sensor_msgs*"])
modules = extensions.cython_extensions(ROOT, packages)
data = {name: ["*.pxd", "*.pyi", "py.typed"] for name in packages}
if environment.must_build_tf2_msgs():
    packages.append(tf2_msgs.NAME)
    modules.append(tf2_msgs.MessagesExtension(ROOT / tf2_msgs.NAME))
    data[tf2_msgs.NAME] = ["package.xml", "msg/*.msg", "srv/*.srv", "action/*.action"]

setup(
    packages=packages,
    package_data=data,
    include_package_data=False,
    ext_modules=modules,
    cmdclass={"build_ext": extensions.BuildExtensions},
    zip_safe=False,
)
