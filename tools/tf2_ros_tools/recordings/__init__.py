"""Read, correct, tabulate and save recordings; users import ``tf2_ros_tools.bag``."""

__all__: list[str] = []
