"""`python -m tf2_ros_cython` is `tf2_ros.cli.which` where `tf2_ros` may be another's, which has none."""

import sys

from tf2_ros_cython.which import main

if __name__ == "__main__":
    sys.exit(main())
