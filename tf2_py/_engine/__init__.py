"""The core behind its lock, and the waits for lookups."""
