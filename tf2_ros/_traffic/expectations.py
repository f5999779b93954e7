"""Owns the file that says what frames must be like."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

__all__ = ["Expectation", "parse", "read"]


@dataclass(frozen=True)
class Expectation:
    """What is expected of one frame; None: nothing."""

    parent: str | None = None
    static: bool | None = None
    min_rate: float | None = None  # Hz
    max_delay: float | None = None  # seconds
    max_future: float | None = None  # seconds; so far ahead its stamps may be


# By the field's name: what its value must be, and how that is called.
_KINDS: Mapping[str, tuple[type | tuple[type, ...], str]] = {
    "parent": (str, "a name"),
    "static": (bool, "true or false"),
    "min_rate": ((int, float), "a number"),
    "max_delay": ((int, float), "a number"),
    "max_future": ((int, float), "a number"),
}
assert set(_KINDS) == {field.name for field in fields(Expectation)}


def read(path: str) -> dict[str, Expectation]:
    """
    Read expectations, by the names of their frames, from a file in YAML.

    :raises OSError: it cannot be read.
    :raises ValueError: it is not YAML, or says something unknown; the text says what, and of which frame.
    """
    import yaml

    with open(path, encoding="utf-8") as file:
        try:
            document = yaml.safe_load(file)
        except yaml.YAMLError as error:
            raise ValueError(" ".join(str(error).split())) from None
    return parse(document)


def parse(document: Any) -> dict[str, Expectation]:
    """
    The same from the objects that YAML gives: ``{"frames": {name: {field of Expectation: value}}}``.

    :raises ValueError: as of :func:`read`.
    """
    if not isinstance(document, dict) or set(document) != {"frames"}:
        raise ValueError("it must have one key, frames")
    frames = document["frames"]
    if not isinstance(frames, dict):
        raise ValueError("frames must be the names of frames, each with what is expected of it")
    return {_name(name): _expectation(name, given) for name, given in frames.items()}


def _name(name: Any) -> str:
    if not isinstance(name, str):
        raise ValueError(f"{name!r} is not a frame's name")
    return name.removeprefix("/")


def _expectation(name: Any, given: Any) -> Expectation:
    if given is None:
        return Expectation()
    if not isinstance(given, dict):
        raise ValueError(f"{name}: what is expected must be of the form parent: odom")
    for key, value in given.items():
        if key not in _KINDS:
            raise ValueError(f"{name}: {key} is none of {', '.join(_KINDS)}")
        kinds, called = _KINDS[key]
        if not isinstance(value, kinds) or (isinstance(value, bool) and kinds is not bool):
            raise ValueError(f"{name}: {key} must be {called}, not {value!r}")
        if value != value:
            raise ValueError(f"{name}: {key} must be {called}, not NaN")
    return Expectation(**given)
