"""The installation itself: which tf2 a program imports, and which ROS 2 this one was built for."""

__all__: list[str] = []
