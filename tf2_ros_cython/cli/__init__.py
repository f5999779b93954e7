"""The command lines of the programs, read without ROS, so that help and completion come at once."""

__all__: list[str] = []
