"""The programs: the work of each, and its name for ``python -m``. Command lines: tf2_ros_cython.cli."""

__all__: list[str] = []
