"""Waiting for transforms: threads that block, futures, deadlines, streams."""
