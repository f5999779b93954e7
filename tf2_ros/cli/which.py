"""Owns a name of the program that tells which tf2 is imported, among those of tf2's other programs."""

import sys

from tf2_ros_cython.which import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
