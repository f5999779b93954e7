"""A reader takes a record longer than what it reads at once; `interposed/spoiled_records.c` spoils it."""

from making_objects import transform
from shared_buffers import pair

with pair() as (owner, reader):
    owner.set_transforms([transform("map", f"f{i}", 1) for i in range(500)], "owner")
    frames = len(reader.frames())
    print(f"{frames} frames, {reader.statistics()['malformed_messages']} malformed messages")
