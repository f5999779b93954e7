"""Explained lookups as Python objects."""

# Uses: times, kept_messages, queries_and_errors, tree_as_objects.

# The object of an explained query. `clock`: for the ages; NULL: there is none. `names` and `authorities`:
# those of the tree.
cdef object new_explanation(const Query* query, const Explained* explained, const ClockReading* clock,
                            list names, list authorities)
