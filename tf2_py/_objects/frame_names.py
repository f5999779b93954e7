# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of frames: how buffers store them, which are invalid, and which resemble an unknown name."""

from collections.abc import Iterable
from difflib import get_close_matches  # not in `closest`: a child forked meanwhile would wait for ever

MOST_SUGGESTED = 3
LONGEST = 100  # characters; longer names, which any sender may choose, are not compared
QUOTES = frozenset('"[]')  # programs search error texts for the names between these


def stored_name(name: str) -> str:
    """
    Get the name under which buffers store a frame that a transform calls ``name``: without one leading ``/``.

    Lookups expect this name. They do not remove a ``/``, but refuse a name that begins with one.

    :raises TypeError: ``name`` is not a str.

    >>> from tf2_py import stored_name
    >>> stored_name("/base_link")
    'base_link'
    """
    return str.removeprefix(name, "/")  # as `name_strip` in C; a TypeError for what is not a str


def is_invalid_name(name: str) -> bool:
    """Whether every lookup refuses this name, because it is empty or begins with a ``/``."""
    return not name or name[0] == "/"


def closest(name: str, known: Iterable[str]) -> list[str]:
    """
    The known names that resemble ``name`` most, best first, at most MOST_SUGGESTED of them.

    Case is ignored. Names that differ only in their namespace, as ``robot1/base_link`` and ``base_link``,
    come first; then those that begin with ``name``.
    """
    if len(name) > LONGEST:
        return []
    wanted = name.casefold()
    folded = {one.casefold(): one for one in known if len(one) <= LONGEST and QUOTES.isdisjoint(one)}
    longer = sorted((one for one in folded if one.startswith(wanted)), key=lambda one: (len(one), one))
    similar = get_close_matches(wanted, folded, MOST_SUGGESTED)
    moved = [one for one in folded if _last_part(one) == _last_part(wanted)]
    return [folded[one] for one in dict.fromkeys([*moved, *longer, *similar])][:MOST_SUGGESTED]


def _last_part(name: str) -> str:
    return name.rpartition("/")[2]
