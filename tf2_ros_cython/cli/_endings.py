"""Owns the formats of files that programs write, which the ends of their names say."""

from argparse import ArgumentTypeError
from collections.abc import Callable
from os.path import splitext

__all__ = ["ending_in", "format_of", "listed"]


def format_of(name: str) -> str:
    """The format that the end of a file's name says."""
    return splitext(name)[1][1:].lower()


def ending_in(*formats: str) -> Callable[[str], str]:
    """For argparse: the name of a file that ends in one of these formats, without their dots."""

    def checked(name: str) -> str:
        if format_of(name) not in formats:
            raise ArgumentTypeError(f"must end in {listed(*formats)}, not {name!r}")
        return name

    return checked


def listed(*formats: str) -> str:
    """The ends of names, for a text."""
    *others, last = (f".{one}" for one in formats)
    return f"{', '.join(others)} or {last}" if others else last
