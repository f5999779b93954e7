"""Maps recordings with two workers, as a program without a guard of its main module does it: FOLDER OUT."""

import sys

from tf2_ros.bag import map_recordings

print(map_recordings(sys.argv[1], "map", "camera", sys.argv[2], workers=2, progress=False))
