# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wait for transforms, in threads that block or with futures and streams; then call a program's code."""
