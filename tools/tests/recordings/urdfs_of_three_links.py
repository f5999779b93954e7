# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""URDFs of robots with the links a, b and c."""

LINKS = "".join(f'<link name="{name}"/>' for name in "abc")


def joint(name, parent, child, kind="revolute", more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'
    )


def robot_of(*parts):
    """A URDF with the links a, b and c."""
    return f"<robot>{LINKS}{''.join(parts)}</robot>"


AB, BC = joint("ab", "a", "b"), joint("bc", "b", "c")
