"""Print which tf2 is imported, and why."""

import sys

from tf2_ros_cython.which import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
