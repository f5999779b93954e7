"""Random sequences of steps for a pair: writing, running and shortening them."""

import random
from collections import Counter
from contextlib import contextmanager

from making import S
from model import STAMPS_END
from model_links import AUTHORITIES, FRAMES, GOOD_PLACES, GOOD_TURNS, ODD_NAMES, PLACES, TURNS
from model_pair import MOST_PENDING, WAITS, Pair
from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level


class Author:
    """Writes one sequence of steps: frames that move on, and mostly stay where they belong."""

    def __init__(self, dice):
        self._dice = dice
        self._frames = FRAMES[: dice.choice((3, 4, 5, 6, 8))]
        self._loops = dice.random() < 0.3
        roots = 0 if self._loops else dice.choice((1, 2, 2, 3))
        self._homes = {child: self._any_parent(child) for child in self._frames[roots:]} or {"b": "a"}
        self._static_share = dice.choice((0.0, 0.05, 0.3))
        self._restless = dice.choice((0.0, 0.05, 0.3))  # how often a frame has another parent
        self._odd = dice.choice((0.0, 0.02, 0.2))  # how often something is invalid
        self._cache_ns = dice.choice((0, 1, 5, 10, 10, 20, 10 * S, 2**62))
        unit = dice.choice((1, 1, 1, self._cache_ns // 10 + 1))  # of the distance between stamps
        self._unit = min(unit, S)
        self._now = dice.choice((0, 1, 30, 30, 1000 * S, STAMPS_END - 100 * self._unit))
        self._newest = {}
        self._last = {}
        self._child = self._frames[-1]

    def steps(self, count):
        yield ("init", self._cache_ns)
        kinds = {
            self._insert: 50,
            self._wait: 25,
            self._end_wait: 6,
            self._clear: 2,
            self._travel: 2,
            self._save: 1,
            self._init: 0.5,
            self._crowd: 0.3,
            self._tie: 3,
        }
        for make in self._dice.choices(list(kinds), list(kinds.values()), k=count - 1):
            step = make()
            if isinstance(step, list):
                yield from step
            else:
                yield step

    def _any_parent(self, child):
        # Without loops each frame hangs from one that comes before it.
        index = self._frames.index(child)
        before = self._frames[:index]
        return self._dice.choice(
            before if before and not self._loops else [f for f in self._frames if f != child]
        )

    def _insert(self):
        dice = self._dice
        count = 1 if dice.random() < 0.8 else dice.randint(0, 6)
        kind = dice.choice(("set", "set", "list", "cdr"))
        way = kind
        if dice.random() < self._static_share:
            way = "static" if kind == "set" else f"static {kind}"
        if count > 1 and way in ("set", "static"):
            way = "list"
        return ("insert", way, tuple(self._link() for _ in range(count)), dice.choice(AUTHORITIES))

    def _crowd(self):
        """More samples of one stamp than are kept."""
        parent, child, ns, _, turn = self._link()
        some = self._dice.sample(range(100, 200), self._dice.randint(60, 70))
        return ("insert", "list", tuple((parent, child, ns, x, turn) for x in some), "crowd")

    def _tie(self):
        """Several parents of one frame at one stamp; then an older sample comes, or the oldest is pruned."""
        dice, unit = self._dice, self._unit
        (_, child, ns, x, turn), other = self._link(), dice.choice(list(self._homes))
        ns = max(0, min(ns, STAMPS_END - 1))
        before = [ns - unit * dice.randint(1, 9) for _ in range(2)]
        after = before[0] + self._cache_ns + dice.randint(0, 2) if self._cache_ns < 100 * S else ns
        child = child if child in self._homes else other
        tied = [(self._any_parent(child), child, ns, x, turn) for _ in range(3)]
        tied += [(self._homes[other], other, ns, x, turn), (*tied[0][:2], max(0, before[0]), x, turn)]
        dice.shuffle(tied)
        edges = [max(0, before[1]), max(ns, min(after, STAMPS_END - 1))]
        late = [
            ("insert", "set", ((*tied[0][:2], edge, x, turn),), dice.choice(AUTHORITIES)) for edge in edges
        ]
        return [("insert", "list", tuple(tied), dice.choice(AUTHORITIES)), self._wait(), *late]

    def _link(self):
        dice = self._dice
        if dice.random() < 0.5:
            self._child = dice.choice(list(self._homes))
        child = self._child
        parent = self._homes.get(child, self._frames[0])
        if dice.random() < self._restless:
            parent = self._any_parent(child)
        if child in self._last and dice.random() < 0.1:
            link = self._last[child]  # repeated, or another of the same stamp
            return link if dice.random() < 0.5 else (*link[:3], dice.randrange(GOOD_PLACES), link[4])
        x, turn = dice.randrange(GOOD_PLACES), dice.randrange(GOOD_TURNS)
        ns = self._stamp(child)
        if dice.random() < self._odd:
            what = dice.randrange(5)
            if what == 0:
                child = dice.choice((*ODD_NAMES, parent))
            elif what == 1:
                parent = dice.choice(ODD_NAMES)
            elif what == 2:
                x = dice.randrange(len(PLACES))
            elif what == 3:
                turn = dice.randrange(len(TURNS))
            else:
                ns = dice.choice((-1, 0, -S, STAMPS_END - 1, STAMPS_END, 2**63 - 1))
        link = self._last[child] = (parent, child, ns, x, turn)
        return link

    def _stamp(self, child):
        dice, unit = self._dice, self._unit
        newest = self._newest.get(child, self._now)
        edge = newest - self._cache_ns
        kind = dice.random()
        if kind < 0.65:
            self._now = ns = self._now + unit * dice.randint(0, 2)
        elif kind < 0.7 and self._cache_ns < 100 * S:
            self._now = ns = self._now + self._cache_ns + dice.randint(-1, 2)  # leaves nothing but this one
        elif kind < 0.8:
            ns = dice.randint(max(edge, newest - 20 * unit), newest)  # late
        elif kind < 0.9:
            ns = edge + dice.randint(-2, 2)
        else:
            ns = newest - unit * dice.randint(0, 20)
        self._now = min(self._now, STAMPS_END - 1)
        ns = max(0, min(ns, STAMPS_END - 1))
        self._newest[child] = max(ns, newest)
        return ns

    def _wait(self):
        dice = self._dice
        lookup = (self._name(), self._name(), self._time())
        if dice.random() < 0.5:
            lookup = (self._homes.get(self._child, "a"), self._child, self._time())
        if dice.random() < 0.3:
            lookup = (*lookup, self._name(), self._time())
        return ("wait", dice.choice(WAITS), lookup)

    def _name(self):
        return self._dice.choice(ODD_NAMES if self._dice.random() < 0.03 else self._frames)

    def _time(self):
        dice, unit = self._dice, self._unit
        ns = self._now + dice.choice(
            (0, unit * dice.randint(0, 4), unit * dice.randint(0, 4), -unit * dice.randint(0, 20), 1)
        )
        if dice.random() < 0.05:
            return dice.choice((-STAMPS_END, -S, -1, 1, STAMPS_END - 1))
        return 0 if dice.random() < 0.3 else max(-5, min(ns, STAMPS_END - 1))

    def _end_wait(self):
        return (self._dice.choice(("cancel", "drop")), self._dice.randrange(MOST_PENDING))

    def _clear(self):
        return ("clear",)

    def _travel(self):
        return ("travel", self._dice.choice(("pickle", "copy", "deepcopy")))

    def _save(self):
        return (self._dice.choice(("save", "restore")),)

    def _init(self):
        return ("init", self._cache_ns)


def run(steps, make_pair=Pair):
    """Take the steps in a new pair: None, or what is broken after the last one that was taken."""
    pair = make_pair()
    for number, step in enumerate(steps):
        try:
            pair.take(step)
        except Exception as broken:
            told = broken if isinstance(broken, AssertionError) else repr(broken)
            return f"after step {number}, {step}: {told}"
    return None


def search(seed, is_over, make_pair=Pair, steps_of_one=80):
    """
    Take sequences of steps, and ask after each step, until `is_over()`.

    Returns
    -------
    counts : Counter
        Of sequences, steps, queries and their outcomes.
    broken : None or (str, list)
        What is broken, and the shortest sequence found that shows it.
    """
    counts = Counter()
    while not is_over():
        dice = random.Random(f"{seed}, {counts['sequences']}")
        pair, taken = make_pair(), []
        for step in Author(dice).steps(steps_of_one):
            taken.append(step)
            try:
                pair.take(step)
                pair.ask(random.Random(len(taken)), full=len(taken) == steps_of_one)
            except Exception as broken:
                found = shortest(taken, broken, make_pair)
                return counts + pair.counts, (f"seed {seed}, {found[0]}", found[1])
            counts["steps"] += 1
        counts["sequences"] += 1
        counts += pair.counts
    return counts, None


def shortest(taken, broken, make_pair=Pair):
    """What is broken, and the shortest sequence found that shows it, of the steps that led there."""
    steps = taken + [broken.query] if getattr(broken, "query", None) else taken
    if not run(steps, make_pair):
        return f"not again: {broken!r}", steps
    single = singles(steps)
    steps = shrink(single if run(single, make_pair) else steps, lambda steps: run(steps, make_pair))
    return run(steps, make_pair), steps


def shrink(steps, breaks):
    """Drop what is not needed to break it: halves, quarters, ..., single steps, until nothing more can go."""
    size = len(steps)
    while size:
        start, shorter = 0, False
        while start < len(steps):
            without = steps[:start] + steps[start + size :]
            if breaks(without):
                steps, shorter = without, True
            else:
                start += size
        if size > 1 or not shorter:
            size //= 2
    return steps


def singles(steps):
    """The same with one link in each insert."""
    single = []
    for step in steps:
        if step[0] == "insert":
            single += [("insert", step[1], (link,), step[3]) for link in step[2]]
        else:
            single.append(step)
    return single


def as_text(steps):
    """What `--replay` of `reliability.model` reads."""
    return "[\n" + "".join(f"    {step!r},\n" for step in steps) + "]"


@contextmanager
def quiet():
    """Without the log lines of refused transforms."""
    level = get_logger_level("tf2_py")
    set_logger_level("tf2_py", LoggingSeverity.FATAL)
    try:
        yield
    finally:
        set_logger_level("tf2_py", level)
