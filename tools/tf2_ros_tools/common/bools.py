# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read arguments that are bools."""

import numpy as np


def bool_of(value: object, argument: str) -> bool:
    """The value, if it is a bool, or one of NumPy; else a TypeError, because ``"no"`` would count as true."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    raise TypeError(f"{argument}: expected a bool, got {type(value).__name__}")
