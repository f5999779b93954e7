"""Mutants of the engine: how many of the faults that one could make in its code the tests find."""
