"""
Pictures of transforms, without a node: of records and arrays, whether a listener or a recording gave them.

- ``tree``: who is whose parent, as Graphviz's DOT. Needs the Python package graphviz.

It is imported by the functions that draw. Names of frames and publishers are shown as
``labels.label`` makes them, for they come from the network and may hold anything.
"""

__all__: list[str] = []
