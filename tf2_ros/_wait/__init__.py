# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wait for transforms: in threads that block, with futures, in filters and in iterations over changes."""
