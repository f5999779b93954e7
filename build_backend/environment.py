"""Owns what the build asks of the machine: a sourced ROS 2, where ROS is installed, the tools."""

import importlib
import importlib.metadata
import os
import re
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path

# One wheel stands for all: the files it installed tell the prefix that holds share/, include/ and lib/.
_LANDMARK = "ros-geometry-msgs"

# The distributions on PyPI, with the first number of their rclpy; the default first.
_RCLPY_OF = {"jazzy": 7, "kilted": 9}
CHOICES = (*_RCLPY_OF, "none")

_chosen: str | None = None


def choose(config_settings):
    """Heed ``-C ros=...`` of pip: the distribution to build for, or none."""
    global _chosen
    _chosen = (config_settings or {}).get("ros")
    if _chosen is not None and _chosen not in CHOICES:
        raise SystemExit(f"tf2-ros-cython knows no -C ros={_chosen}: give one of {', '.join(CHOICES)}")
    if _chosen in _RCLPY_OF and ros_is_sourced():
        sourced = rclpy_version(ament_prefixes())
        if sourced is not None and int(sourced.partition(".")[0]) != _RCLPY_OF[_chosen]:
            raise SystemExit(
                f"tf2-ros-cython cannot be built for {_chosen} where a ROS 2 with rclpy {sourced} is sourced:"
                f" leave out -C ros={_chosen}, or use a shell that has not sourced that ROS 2"
            )


def without_ros():
    """Whether to build what needs no ROS alone."""
    return _chosen == "none"


def ros_wheels():
    """
    The wheels to build with, which hold the generators, too; none where a ROS 2 is sourced or unwanted.

    Whoever installs into an environment that has the wheels of one distribution is taken to mean that one.
    """
    if without_ros() or ros_is_sourced():
        return []
    name = _chosen or _installed_distribution() or next(iter(_RCLPY_OF))
    return [f"ros-{name}-rclpy[fastrtps]", f"ros-{name}-common-interfaces"]


def rclpy_version(prefixes):
    """The version of the first rclpy among the prefixes, or None."""
    for prefix in prefixes:
        manifest = prefix / "share" / "rclpy" / "package.xml"
        if manifest.is_file():
            found = re.search(r"<version>\s*([\d.]+)", manifest.read_text(encoding="utf-8"))
            return found.group(1) if found else None
    return None


def _installed_distribution():
    # Build isolation hides the packages of the environment to install into, and not its folder.
    version = rclpy_version([Path(sys.prefix)])
    names = [name for name, major in _RCLPY_OF.items() if version and version.startswith(f"{major}.")]
    return names[0] if names else None


def ament_prefixes(environ=os.environ):
    """The install prefixes of a sourced ROS 2, the overlay first; none where nothing is sourced."""
    return [Path(entry) for entry in environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if entry]


def ament_offers(package, environ=os.environ):
    """Whether a sourced ROS 2 holds ``package``, by the marker that every ament package installs."""
    marker = Path("share", "ament_index", "resource_index", "packages", package)
    return any((prefix / marker).is_file() for prefix in ament_prefixes(environ))


def ros_is_sourced(environ=os.environ):
    """Whether ROS 2 for Python comes from the environment, so that no wheel of it is pulled in beside it."""
    return ament_offers("rclpy", environ)


def must_build_tf2_msgs(environ=os.environ):
    """Whether this distribution brings ``tf2_msgs``: never where it would shadow the environment's own."""
    return not without_ros() and not ament_offers("tf2_msgs", environ)


def ros_prefixes(environ=os.environ):
    """
    The prefixes to generate from and to link with.

    Without a sourced ROS 2 that is where the wheels lie: under build isolation the build environment's own
    prefix, which is not ``sys.prefix``.
    """
    if without_ros():
        return []
    if ros_is_sourced(environ):
        return ament_prefixes(environ)
    # All answers: the finder by which pip finds a build backend answers any name with the project itself.
    for found in importlib.metadata.distributions(name=_LANDMARK):
        for file in found.files or []:
            if file.parts[-3:] == ("share", "geometry_msgs", "package.xml"):
                return [Path(file.locate()).resolve().parents[2]]
    raise SystemExit(
        "tf2-ros-cython found no ROS 2 to build tf2_msgs with. Build with isolation (plain `pip install .`),"
        " or source a ROS 2, or first: pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces;"
        " without ROS 2: pip install . -C ros=none"
    )


def share_directory(package, prefixes):
    """``share/<package>`` of the first prefix that has it."""
    for prefix in prefixes:
        if (prefix / "share" / package).is_dir():
            return prefix / "share" / package
    searched = os.pathsep.join(map(str, prefixes))
    raise SystemExit(f"tf2-ros-cython needs {package}, which the ROS 2 in {searched} lacks: install it there")


def missing_tools(environ=os.environ):
    """One line for each thing that the build needs and pip cannot bring, with what to install."""
    wanted = [("C", "CC", "gcc")]
    if must_build_tf2_msgs(environ):
        # The type support of Fast DDS is C++; everything else is C.
        wanted.append(("C++", "CXX", "g++"))
    missing = []
    for language, variable, package in wanted:
        command = environ.get(variable) or sysconfig.get_config_var(variable) or package
        program = shlex.split(command)[0]
        if not shutil.which(program, path=environ.get("PATH")):
            missing.append(f"no {language} compiler ({program}): install {package}")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append("no headers of this Python: install its development package, python3-dev on Debian")
    return missing


def refuse_old_cython():
    """End the build where Cython is lacking or too old: colcon, unlike pip, installs nothing for a build."""
    try:
        version = importlib.import_module("Cython").__version__
    except ImportError:
        version = None
    if version is None or tuple(map(int, version.split(".")[:2])) < (3, 2):
        found = f"has {version}" if version else "has none"
        raise SystemExit(
            f"tf2-ros-cython needs Cython 3.2 or newer, and {sys.executable} {found}: with that Python,"
            " pip install --user 'Cython>=3.2,<3.3'"
        )


def refuse_incomplete(environ=os.environ):
    """End the build with a message that pip shows, and no traceback, where a tool is missing."""
    missing = missing_tools(environ)
    if missing:
        raise SystemExit("tf2-ros-cython cannot be built here: " + "; ".join(missing))
