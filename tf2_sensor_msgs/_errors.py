# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The errors of inconsistent clouds."""


class FieldError(ValueError, AssertionError):
    """A coordinate is missing or invalid. tf2 asserts that it exists."""


class SizeError(ValueError, TypeError):
    """There are too few bytes for the points, or too many in a row. In tf2, NumPy raises a TypeError."""
