"""Owns what a process does not clean up at its exit: in a forked child, what needs threads of its parent."""

from cpython.ref cimport Py_INCREF


def keep_for_ever(*things):
    """Never destroy these, not even at the interpreter's end."""
    for thing in things:
        Py_INCREF(thing)
