"""A reader takes a record that is longer than what it reads at once; `interposed/reads_once.c` spoils it."""

from making import transform
from sharing import pair

with pair() as (owner, reader):
    owner.set_transforms([transform("map", f"f{i}", 1) for i in range(500)], "owner")
    frames = len(reader.frames())
    print(f"{frames} frames, {reader.statistics()['malformed_messages']} malformed messages")
