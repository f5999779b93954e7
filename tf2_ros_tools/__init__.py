"""
Recordings, figures, pictures and programs: what is beyond tf2. It uses public names of ``tf2_ros`` only.

Users find it as ``tf2_ros.bag``, ``tf2_ros.rerun``, ``tf2_ros.urdf`` and ``python -m tf2_ros.cli.<name>``,
and as programs.
"""

__all__: list[str] = []
