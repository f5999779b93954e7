"""Owns finding the known frame names that resemble an unknown one."""

import heapq
from collections.abc import Iterable
from difflib import SequenceMatcher

MOST_SUGGESTED = 3
MOST_COMPARED = 16  # by all of difflib, whose cost grows with the square of a length; the others by letters
LONGEST = 100  # characters of a name that is compared at all: names come from senders, too
CUTOFF = 0.6  # difflib's own: how alike two names must be, from 0 to 1
QUOTES = frozenset('"[]')  # programs search error texts for what stands between these


def closest(name: str, known: Iterable[str]) -> list[str]:
    """
    The known names that resemble ``name`` most, best first, at most MOST_SUGGESTED of them.

    Case does not count, and a name in another namespace (``robot1/base_link`` for ``base_link``) is alike.
    """
    if len(name) > LONGEST:
        return []
    wanted = name.casefold()
    wanted_part = _last_part(wanted)
    matcher = SequenceMatcher(autojunk=False)
    matcher.set_seq2(wanted)
    rated = []
    for one in known:
        if len(one) > LONGEST or not QUOTES.isdisjoint(one):
            continue
        folded = one.casefold()
        is_moved = _last_part(folded) == wanted_part
        matcher.set_seq1(folded)
        # Each ratio is an upper bound of the next one, and takes less time.
        if is_moved or matcher.real_quick_ratio() >= CUTOFF:
            rating = matcher.quick_ratio()
            if is_moved or rating >= CUTOFF:
                rated.append((is_moved, rating, folded, one))
    found = []
    for is_moved, _, folded, one in heapq.nlargest(MOST_COMPARED, rated):
        matcher.set_seq1(folded)
        ratio = matcher.ratio()
        if is_moved or ratio >= CUTOFF:
            found.append((is_moved, ratio, one))
    return [one for _, _, one in heapq.nlargest(MOST_SUGGESTED, found)]


def _last_part(name: str) -> str:
    return name.rpartition("/")[2]
