"""Wait for transforms: in threads that block, and with futures, deadlines and streams."""
