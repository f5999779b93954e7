# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the other folders share: command lines, loops, output, rotations, files and optional libraries."""

__all__: list[str] = []
