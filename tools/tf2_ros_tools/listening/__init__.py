"""Listen to a robot for commands, with a node of ROS or without ROS."""

__all__: list[str] = []
