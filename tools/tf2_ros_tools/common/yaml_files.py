# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read YAML files that people write: expectations, static transforms."""

import re
from collections import Counter
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from tf2_py import stored_name
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.program import UsageError

NOT_DECIMAL = re.compile(r"[-+]?0[\d_]|.*:")  # in YAML 1.1, 010 is 8, and 1:30 is 90
LAST_S = 2**31 - 1  # the last stamp that a message can hold


def read_yaml(path: Path) -> Any:
    """
    Read a YAML file.

    :raises MissingLibraryError: PyYAML is not installed.
    :raises UsageError: the file cannot be read, or is not YAML.
    """
    require("yaml", "cli")
    import yaml

    class Loader(yaml.SafeLoader):
        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
            keys = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
            for key in (key for key, count in keys.items() if count > 1):  # PyYAML keeps the last one
                raise yaml.MarkedYAMLError(problem=f"{key!r} occurs twice", problem_mark=node.start_mark)
            return super().construct_mapping(node, deep)

        def construct_number(self, node: yaml.ScalarNode) -> Any:
            if NOT_DECIMAL.match(node.value):
                problem = f"expected a decimal number, got {node.value!r}"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
            is_int = node.tag == "tag:yaml.org,2002:int"
            return self.construct_yaml_int(node) if is_int else self.construct_yaml_float(node)

    for kind in ("int", "float"):
        Loader.add_constructor(f"tag:yaml.org,2002:{kind}", Loader.construct_number)
    try:
        with open(path, encoding="utf-8") as file:
            return yaml.load(file, Loader)
    except OSError as refusal:
        raise UsageError(f"cannot read {path}: {refusal.strerror}") from None
    except (ValueError, RecursionError, yaml.YAMLError) as refusal:  # a wrong date is a ValueError
        raise UsageError(f"{path} is not YAML: {refusal}") from None


def read_list(path: Path, what: str, example: str) -> list[Any]:
    """
    Read a YAML file that contains a list.

    :param what: what the list contains, for the error.
    :param example: an entry of it, for the error.
    :raises MissingLibraryError, UsageError: see :func:`read_yaml`; or it contains no list with entries.
    """
    entries = read_yaml(path)
    if not isinstance(entries, list) or not entries:
        raise UsageError(f"{path} must contain a list of {what}, such as: - {example}")
    return entries


class Key(NamedTuple):
    """A key of a mapping: what is expected of its value, in words, and a function that reads it."""

    expected: str
    read: Callable[[Any], Any]  # raises a ValueError, or returns None, for what is not as expected
    is_required: bool = False


def frame_name(value: Any) -> str | None:
    """Read the name of a frame, as buffers store it."""
    name = stored_name(value) if isinstance(value, str) else ""
    return name if name and not name.startswith("/") else None  # lookups refuse any other


def boolean(value: Any) -> bool | None:
    """Read true or false."""
    return value if isinstance(value, bool) else None


def number_in(least: float, most: float = LAST_S) -> Callable[[Any], float | None]:
    """Make a function that reads a number in a range that includes both ends."""

    def read_number(value: Any) -> float | None:
        # YAML reads 1e-3 as a string.
        if isinstance(value, bool) or not isinstance(value, (int, float, str)):
            return None
        return number if least <= (number := float(value)) <= most else None

    return read_number


NOT_NEGATIVE = Key("a number that is not negative", number_in(0.0))


def read_keys(label: str, given: Any, keys: Mapping[str, Key], example: str = "") -> dict[str, Any]:
    """
    Read a mapping.

    :param label: what has the mapping, for the error.
    :param example: such a mapping, for errors about its shape.
    :return: the values of the keys that it has.
    :raises ValueError: it is no mapping, a key is unknown or missing, or a value is not as expected.
    """
    required = [key for key in keys if keys[key].is_required]
    if not isinstance(given, dict):
        expected = f"a mapping with {' and '.join(required or keys)}{f', such as {example}' * bool(example)}"
        raise ValueError(f"{label}: expected {expected}, got {given!r}")
    for key in given:
        if key not in keys:
            near = get_close_matches(str(key), keys, n=1)
            advice = f"did you mean {near[0]}?" if near else f"the keys are {', '.join(keys)}"
            raise ValueError(
                f"{label}: {key!r} is not a key; {advice}{f'; an example is {example}' * bool(example)}"
            )
    read = {}
    for key in dict.fromkeys([*given, *required]):
        try:
            read[key] = keys[key].read(given.get(key))
        except (ValueError, OverflowError):
            read[key] = None
        if read[key] is None:
            found = repr(given[key]) if key in given else "nothing"
            raise ValueError(f"{label}: '{key}': expected {keys[key].expected}, got {found}")
    return read
