# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read a URDF, and compute the transforms of its joints from joint states: ``load``, ``Robot``."""

import os
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from graphlib import CycleError, TopologicalSorter
from math import hypot, inf, isfinite
from os import PathLike
from pathlib import Path
from typing import TypeAlias

# Only the names, parents and numbers of joints are needed; for these, yourdfpy would add lxml and trimesh to
# the dependencies, and urdf-parser-py lxml.
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tf2_py import stored_name
from tf2_py.printable import printable
from tf2_ros.numpy import to_matrix
from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.common.output import first_names
from tf2_ros_tools.common.roll_pitch_yaw import quaternion_from_rpy

__all__ = ["Joint", "Robot", "UrdfError", "load"]

Floats: TypeAlias = "NDArray[np.float64]"
Numbers: TypeAlias = "tuple[float, ...]"

TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)
TYPES = ("fixed", *TURNING, *SLIDING, "planar", "floating")
NOT_EXPANDED = "it contains xacro, which must be expanded first: `xacro robot.xacro > robot.urdf`"


class UrdfError(ValueError):
    """A URDF cannot be used; the text contains the joint or link, and the fault."""


@dataclass(frozen=True)
class Joint:
    """
    A joint of a robot.

    :param name: its name in joint states.
    :param type: fixed, revolute, continuous or prismatic.
    :param parent: the frame of its parent link, with the prefix.
    :param child: the frame of its child link, which is also the frame of the joint.
    :param translation: x y z of the child in the parent at position 0, meters.
    :param rotation: the rotation of the child in the parent at position 0, a quaternion x y z w.
    :param axis: the axis of motion in the frame of the joint, a vector of length one.
    :param mimic: the joint that this one follows, the multiplier and the offset; or None. If there is no such
        joint, this one moves only by its own position.
    """

    name: str
    type: str
    parent: str
    child: str
    translation: Numbers
    rotation: Numbers
    axis: Numbers
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True, eq=False)
class Robot:
    """
    The joints of a URDF, in its order.

    As for ``robot_state_publisher``, planar joints are fixed, and floating joints are left out, because other
    nodes publish them.

    :param name: the robot's name in the URDF.
    :param root: the frame of the link without a parent, with the prefix.
    :param joints: all of them.
    :param warnings: a sentence for each probable mistake in the URDF.
    :param floating: the names of the floating joints.
    """

    name: str
    root: str
    joints: tuple[Joint, ...]
    warnings: tuple[str, ...] = ()
    floating: tuple[str, ...] = ()

    def __repr__(self) -> str:
        moving = sum(one.type != "fixed" for one in self.joints)
        joints = f"{moving} movable and {len(self.joints) - moving} fixed joints"
        return f"<tf2_ros_tools.urdf.Robot {self.name!r}: {joints}, root {self.root!r}>"

    def transforms(self, names: Sequence[str], positions: ArrayLike) -> tuple[list[Joint], Floats, Floats]:
        """
        Compute the transforms of the joints whose positions are given, from the child to the parent.

        :param names: of K joints, as in a ``sensor_msgs/JointState``; unknown names are ignored; of
            duplicates, the first counts.
        :param positions: radians or meters, shape (K,), or (N, K) for N times.
        :return: M joints, their translations in meters, shape (M, 3) or (N, M, 3), and their rotations x y z
            w, shape (M, 4) or (N, M, 4). A position of NaN makes the numbers of its joint NaN.
        :raises ValueError: ``positions`` has another shape.
        """
        values = np.asarray(positions, np.float64)
        joints, compute = _plan(self, tuple(names))
        if values.ndim not in (1, 2) or values.shape[-1] != len(names):
            raise ValueError(
                f"positions: expected the shape ({len(names)},) or (N, {len(names)}), got {values.shape}"
            )
        with np.errstate(invalid="ignore", over="ignore"):  # the sine of infinity is NaN
            return [*joints], *compute(values)


@lru_cache(maxsize=20)  # a few publishers share a topic; one that invents names must not fill the memory
def _plan(
    robot: Robot, names: tuple[str, ...]
) -> tuple[list[Joint], Callable[[Floats], tuple[Floats, Floats]]]:
    """Get the joints that these names move, and a function that computes their transforms from positions."""
    place = {name: i for i, name in reversed([*enumerate(names)])}
    by_name = {one.name: one for one in robot.joints}

    def source(joint: Joint) -> tuple[int, float, float] | None:
        """The place of the joint that this one follows, the factor and the offset."""
        factor, offset = 1.0, 0.0
        while joint.name not in place:
            if joint.mimic is None or joint.mimic[0] not in by_name:
                return None
            followed, multiplier, added = joint.mimic
            factor, offset = factor * multiplier, offset + factor * added
            joint = by_name[followed]
        return place[joint.name], factor, offset

    moving = [one for one in robot.joints if one.type != "fixed"]
    found = [(one, followed) for one in moving if (followed := source(one)) is not None]
    joints = [one for one, _ in found]
    places, factors, offsets = np.reshape([followed for _, followed in found], (-1, 3)).T
    turning = np.array([one.type in TURNING for one in joints], np.bool_)
    # At position 0; and what a turn of the half angle, or a slide, adds to it.
    at_zero = np.reshape([(*one.translation, *one.rotation) for one in joints], (-1, 7))
    slides = np.reshape([_rotated(one.rotation, one.axis) * (one.type in SLIDING) for one in joints], (-1, 3))
    turned = np.reshape([_times(one.rotation) @ (*one.axis, 0.0) for one in joints], (-1, 4))

    def compute(values: Floats) -> tuple[Floats, Floats]:
        simple = (values[..., places.astype(np.intp)] * factors + offsets)[..., None]
        half = simple * turning[:, None] * 0.5
        translations = at_zero[:, :3] + simple * slides
        # A product of quaternions is linear: q0 (a sin, cos) = q0 cos + q0 (a, 0) sin.
        rotations = at_zero[:, 3:] * np.cos(half) + turned * np.sin(half)
        return translations, rotations

    return joints, compute


def _times(q: ArrayLike) -> Floats:
    """The matrix that multiplies a quaternion, x y z w, by this one from the left."""
    x, y, z, w = np.asarray(q, np.float64)
    return np.array(((w, -z, y, x), (z, w, -x, y), (-y, x, w, z), (-x, -y, -z, w)))


def _rotated(q: ArrayLike, vectors: ArrayLike) -> Floats:
    """Rotate vectors, shape (..., 3), by a quaternion x y z w."""
    turned: Floats = np.asarray(vectors, np.float64) @ to_matrix((np.zeros(3), np.asarray(q)))[:3, :3].T
    return turned


def fixed(robot: Robot, without: Collection[str]) -> bytes:
    """Make a TFMessage of the fixed joints, except those whose frames are in ``without``."""
    joints = [one for one in robot.joints if one.type == "fixed" and one.child not in without]
    frames = [(one.parent, one.child) for one in joints]
    transforms = [[*one.translation, *one.rotation] for one in joints]
    return serialize_arrays(frames, [0] * len(joints), transforms)


def unmatched(robot: Robot, names: Iterable[str]) -> str:
    """
    Say which names of joint states are not joints of a robot, and which joints they lack.

    :return: empty if all are joints, or if no joint of the robot moves.
    """
    given, known = dict.fromkeys(names), {*robot.floating, *(one.name for one in robot.joints)}
    unknown = [name for name in given if name not in known]
    movable = [one for one in robot.joints if one.type != "fixed"]
    if not unknown or not movable:
        return ""
    lack = [one.name for one in movable if one.mimic is None and one.name not in given]
    text = f"{first_names(unknown)} {'is not a joint' if len(unknown) == 1 else 'are not joints'} of the URDF"
    return f"{text}; missing there: {first_names(lack)}" if lack else text


# Read a URDF.


def load(source: "str | PathLike[str]", *, prefix: str = "") -> Robot:
    """
    Read the joints of a URDF. Python warnings report joints that mimic an unknown joint.

    :param source: the path of a file, or the text itself, whose first character is ``<``.
    :param prefix: a text to put in front of the names of all frames, for several robots. One leading ``/`` of
        a link, and of the resulting name, is removed, as a buffer does.
    :return: the robot.
    :raises FileNotFoundError: the file does not exist.
    :raises UrdfError: it is not a URDF, or does not describe a tree.
    """
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        robot = parse(source, prefix)
    else:
        try:
            robot = parse(Path(source).read_bytes(), prefix)
        except UrdfError as error:
            raise UrdfError(f"{printable(os.fspath(source))}: {error}") from None
    for problem in robot.warnings:
        warnings.warn(problem, stacklevel=2)
    return robot


def _elements(text: str | bytes) -> ElementTree.Element:
    """Read XML as urdfdom does, and so ``robot_state_publisher``: prefixes are parts of names."""
    # A text in Python, as in a launch file, often begins with a blank line.
    data, encoding = (text.lstrip("\ufeff \t\r\n"), "utf-8") if isinstance(text, str) else (text, None)
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate(encoding)
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.Parse(data, True)
    return builder.close()


def parse(text: str | bytes, prefix: str = "") -> Robot:
    """Read the text of a URDF; see :func:`load`."""
    try:
        root = _elements(text)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UrdfError(f"not XML: {error}") from None
    if root.tag != "robot":
        raise UrdfError(f"expected the root element <robot>, got <{printable(root.tag)}>")
    in_joints = [part for joint in root.findall("joint") for part in joint.iter()]
    values = [value for one in (*root.findall("link"), *in_joints) for value in one.attrib.values()]
    is_of_xacro = any(one.tag.startswith("xacro:") for one in (*root, *in_joints))
    if is_of_xacro or any("${" in one or "$(" in one for one in values):
        raise UrdfError(NOT_EXPANDED)
    links = _names(root, "link")
    _names(root, "joint")
    joints = [_joint(element, links) for element in root.findall("joint")]
    frames = _frames(links, prefix)
    named = (
        replace(one, parent=frames[one.parent], child=frames[one.child])
        for one in joints
        if one.type != "floating"
    )
    floating = tuple(one.name for one in joints if one.type == "floating")
    problems = tuple(_unknown_mimics(joints))
    return Robot(root.get("name", ""), frames[_root(links, joints)], tuple(named), problems, floating)


def _frames(links: set[str], prefix: str) -> dict[str, str]:
    """Get the frames of links, as buffers store them, by the names of the links."""
    frames = {link: stored_name(prefix + stored_name(link)) for link in sorted(links)}
    by_frame: dict[str, str] = {}
    for link, frame in frames.items():
        if (other := by_frame.setdefault(frame, link)) != link:
            raise UrdfError(f"the links {printable(other)} and {printable(link)} are the same frame")
    return frames


def _unknown_mimics(joints: Iterable[Joint]) -> list[str]:
    """Get a text for each joint that mimics an unknown one."""
    joints = [one for one in joints if one.type != "floating"]
    names = {joint.name for joint in joints}
    mimics = [(joint.name, joint.mimic[0]) for joint in joints if joint.mimic is not None]
    return [
        f"joint {printable(name)} mimics {printable(followed)}, which is not a joint; "
        "it is left out, except where its own position is given"
        for name, followed in mimics
        if followed not in names
    ]


def _names(root: ElementTree.Element, tag: str) -> set[str]:
    names: set[str] = set()
    for element in root.findall(tag):
        name = _attribute(element, "name", f"a {tag}")
        if name in names:
            raise UrdfError(f"there are two {tag}s {printable(name)}")
        names.add(name)
    return names


def _joint(element: ElementTree.Element, links: set[str]) -> Joint:
    name = element.get("name", "")
    where = f"joint {printable(name)}"
    kind = _attribute(element, "type", where)
    if kind not in TYPES:
        raise UrdfError(
            f"{where}: expected the type {', '.join(TYPES[:-1])} or {TYPES[-1]}, got {printable(kind)}"
        )
    parent, child = (_link(element, tag, where, links) for tag in ("parent", "child"))
    axis: Numbers = (1.0, 0.0, 0.0)
    if kind in (*TURNING, *SLIDING):
        axis = _numbers(element.find("axis"), "xyz", where, "1 0 0")
        if not 0.0 < (length := hypot(*axis)) < inf:
            raise UrdfError(f"{where}: its axis must not be (0, 0, 0)")
        axis = tuple(one / length for one in axis)
    mimic, follows = element.find("mimic"), None
    if mimic is not None:
        followed = _attribute(mimic, "joint", f"the mimic of {where}")
        [multiplier] = _numbers(mimic, "multiplier", where, "1")
        [offset] = _numbers(mimic, "offset", where, "0")
        follows = followed, multiplier, offset
    origin = element.find("origin")
    xyz, rpy = (_numbers(origin, name, where, "0 0 0") for name in ("xyz", "rpy"))
    kind = "fixed" if kind == "planar" else kind
    return Joint(name, kind, parent, child, xyz, quaternion_from_rpy(*rpy), axis, follows)


def _link(joint: ElementTree.Element, tag: str, where: str, links: set[str]) -> str:
    element = joint.find(tag)
    if element is None:
        raise UrdfError(f"{where} has no {tag}")
    name = _attribute(element, "link", f"the {tag} of {where}")
    if name not in links:
        raise UrdfError(f"{where}: its {tag} {printable(name)} is not a link of the robot")
    return name


def _root(links: set[str], joints: Iterable[Joint]) -> str:
    """Get the link without a parent; raise an error if the joints are not a tree."""
    above: dict[str, Joint] = {}
    for joint in joints:
        other = above.setdefault(joint.child, joint)
        if other is not joint:
            link, one, two = map(printable, (joint.child, other.name, joint.name))
            raise UrdfError(f"link {link} has two parents: it is the child of the joints {one} and {two}")
    if (name := one_in_a_loop({child: joint.parent for child, joint in above.items()})) is not None:
        raise UrdfError(f"link {printable(name)} is its own ancestor")
    mimics = {joint.name: joint.mimic[0] for joint in joints if joint.mimic is not None}
    if (name := one_in_a_loop(mimics)) is not None:
        raise UrdfError(f"joint {printable(name)} mimics itself")
    roots = sorted(links - above.keys())
    if len(roots) != 1:
        found = f"expected one link without a parent, got {len(roots)}: {first_names(roots)}"
        raise UrdfError(found if roots else "the robot has no links")
    return roots[0]


def one_in_a_loop(above: Mapping[str, str]) -> str | None:
    """Get a name that is above itself; None: there is none."""
    try:
        TopologicalSorter({name: [other] for name, other in above.items()}).prepare()
    except CycleError as loop:
        return str(min(loop.args[1]))
    return None


def _attribute(element: ElementTree.Element, name: str, where: str) -> str:
    value = element.get(name)
    if not value:
        raise UrdfError(f"{where} has no {name}")
    return value


def _numbers(element: ElementTree.Element | None, name: str, where: str, default: str) -> Numbers:
    text = default if element is None else element.get(name, default)
    try:
        numbers = tuple(map(float, text.split()))
    except ValueError:
        numbers = ()
    if len(numbers) != len(default.split()) or not all(map(isfinite, numbers)):
        count = {1: "a finite number", 3: "three finite numbers"}[len(default.split())]
        raise UrdfError(f"{where}: {name}: expected {count}, got {text!r}")
    return numbers
