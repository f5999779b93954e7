"""Provide what commands do with a node of ROS: spin, listen, relay and publish."""

__all__: list[str] = []
