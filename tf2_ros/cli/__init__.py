"""``python -m tf2_ros.cli.<name>``: the programs, which are the modules of ``tf2_ros_tools.programs``."""

from tf2_ros_tools import programs

__all__: list[str] = []

__path__.extend(programs.__path__)
