"""Buffers that the processes of a machine share: the memory, who owns it, and following it."""
