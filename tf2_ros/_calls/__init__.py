# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Call a program's code in what runs its node: an executor, an event loop, or a thread."""
