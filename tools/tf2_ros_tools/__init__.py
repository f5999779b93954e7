"""
Recordings, figures, pictures and programs: what is beyond tf2. It uses public names of ``tf2_ros`` only.

Users import ``tf2_ros_tools.bag``, ``tf2_ros_tools.live``, ``tf2_ros_tools.rerun`` and
``tf2_ros_tools.urdf``. They start the programs by name, or with ``python -m tf2_ros_tools.programs.<name>``.
"""

__all__: list[str] = []
