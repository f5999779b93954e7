"""How often the lock of an engine was taken."""

from tf2_py._internal cimport Engine


def locks_of(Engine engine):
    return engine._lock.asked
