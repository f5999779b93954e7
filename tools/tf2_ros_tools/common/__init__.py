# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parse command lines, format output, read files and report missing libraries, for all other folders."""

__all__: list[str] = []
