# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Queue calls of a program's code, make them in what runs its node, an executor or an event loop, and wake that
executor for transforms that arrive.
"""
