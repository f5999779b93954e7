# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``python -m tf2_ros_cython`` is ``tf2_which``, also if another tf2_ros is imported."""

import sys

from tf2_ros_cython.which import main

if __name__ == "__main__":
    sys.exit(main())
