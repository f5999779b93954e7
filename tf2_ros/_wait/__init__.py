"""Wait for transforms: in threads that block, and with futures and streams."""
