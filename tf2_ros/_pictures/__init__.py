"""
Pictures of transforms, without a node: of records and arrays, whether a listener or a recording gave them.

- ``tree``: who is whose parent, as Graphviz's DOT. Needs the Python package graphviz.
- ``heard``: when each frame was received. Needs matplotlib.
- ``trajectory``: where a frame was, from above and over time. Needs matplotlib.

Both libraries are imported by the functions that draw. Names of frames and publishers are shown as
``labels.label`` makes them, for they come from the network and may hold anything.
"""

__all__: list[str] = []
