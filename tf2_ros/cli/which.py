"""Owns the name by which tf2's users find the program that prints which tf2 is imported."""

import sys

from tf2_ros_cython.which import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
