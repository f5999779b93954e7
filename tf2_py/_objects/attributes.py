"""Owns the attributes that subclasses add to a buffer: they travel with it."""

import copyreg
from typing import Any

__all__ = ["attributes_of", "check_attributes", "set_attributes"]


def attributes_of(thing: Any) -> dict[str, Any]:
    """What is in its ``__dict__`` and in the slots of its classes."""
    attributes = dict(getattr(thing, "__dict__", {}))
    for name in _slots_of(thing):
        if hasattr(thing, name):
            attributes[name] = getattr(thing, name)
    return attributes


def check_attributes(thing: Any, attributes: object) -> None:
    """ValueError: they cannot be its attributes."""
    if type(attributes) is not dict or not all(type(name) is str for name in attributes):
        raise ValueError("not the state of a buffer: its attributes are no dict with names as keys")
    if not hasattr(thing, "__dict__") and attributes.keys() - _slots_of(thing):
        raise ValueError(f"not the state of a buffer: a {type(thing).__name__} has no attributes of its own")


def set_attributes(thing: Any, attributes: dict[str, Any]) -> None:
    """Set them past a ``__setattr__`` of the class, as pickle does: it may rely on what ``__init__`` does."""
    slots = _slots_of(thing)
    for name in attributes.keys() & slots:
        object.__setattr__(thing, name, attributes[name])
    if attributes.keys() - slots:
        thing.__dict__.update({name: attributes[name] for name in attributes if name not in slots})


def _slots_of(thing: Any) -> set[str]:
    return set(copyreg._slotnames(type(thing)))  # type: ignore[attr-defined]
