"""
Buffers and tables from recordings. No module of this package needs ROS, or a node.

- ``reading``: recordings of all formats as raw messages in CDR, through ``rosbags``.
- ``problems``: the errors about them.
- ``rescue``: what can be read of a broken one.
- ``fill``: raw messages into a buffer, and into the records that ``tf2_ros._traffic`` judges.
- ``loading``: ``tf2_ros.bag.load`` and ``tf2_ros.bag.transforms``.
- ``hearing``: the same as a listener would have heard it.
- ``tables``: looked-up transforms as files.
- ``report``: what is wrong in a recording.
- ``fleet``: tables and findings of many recordings. ``searching`` finds them, ``mapping`` is what is
  done with one, ``workers`` where it is done, ``local_workers`` those of this machine, ``findings_file`` the
  table of findings.
- ``progress``: bars.
"""

__all__: list[str] = []
