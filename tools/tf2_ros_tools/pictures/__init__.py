# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Draw what other modules compute, as pictures and on a terminal."""

__all__: list[str] = []
