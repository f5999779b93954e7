# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps recordings with two workers: FOLDER OUT."""

import sys

from tf2_ros_tools.bag import map_recordings

if __name__ == "__main__":
    print(map_recordings(sys.argv[1], "map", "camera", sys.argv[2], workers=2, progress=False))
