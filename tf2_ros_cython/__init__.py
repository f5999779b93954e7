"""The installation itself: which tf2 a program imports, and which ROS 2 it uses."""

__all__: list[str] = []
