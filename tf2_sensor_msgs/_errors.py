"""Owns the errors of inconsistent clouds."""

__all__ = ["FieldError", "SizeError"]


class FieldError(ValueError, AssertionError):
    """A coordinate is missing or makes no sense. tf2 asserts that they are there."""


class SizeError(ValueError, TypeError):
    """There are fewer bytes than points. NumPy, which tf2 reads clouds with, makes a TypeError of it."""
