"""
What can be said of received transforms, without a node: rates, delays, and what is wrong.

In go arrays of ``tf2_ros._receive.recording.RECORD``, in the order of arrival. Their ``child``, ``parent``
and ``publisher`` are indices into lists that the caller keeps: those of a ``Recording``, which a listener
fills (``tf2_ros.cli._listening``), or those that a reader of recordings makes. Out come plain records:

- ``streams.Streams``: ``add(records)``, then ``report(now_ns, frames, publishers)`` gives one
  ``streams.Stream`` for each frame, with its parent, publisher, rate and delay; of a frame that is published
  doubly, one for each publisher and parent. Beside them stand the ``streams.Refused``: transforms that every
  buffer refuses, and that therefore are part of no stream and no tree.
- ``settling.Settling``: ``early(records)`` says what arrived while its publisher was being discovered, and
  ``Streams.add(records, early)`` thins it out.
- ``findings.find(streams, limits, expectations, alive, refused=...)`` gives ``findings.Finding``: what is
  wrong with them.
- ``chains.newest_streams(streams)``: the tree, as a buffer sees it. ``chains.chain_between(newest, a, b)``:
  the frames between two frames. ``chains.NetDelay``: how old the newest transform between them is.
- ``expectations.read(path)``: what a file says that frames must be like.

All times in the arrays are ns of one clock, that of the listener; those of the records that come out are in
seconds. Arrays are never changed. How the records are cut into arrays changes no figure and no finding.
"""

__all__: list[str] = []
