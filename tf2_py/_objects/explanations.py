# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Explained lookups: the hops between two frames, and the samples that each has answered with."""

import math
from html import escape
from typing import TYPE_CHECKING, Literal, NamedTuple

from tf2_py._objects.errors import NS_PER_S, in_days, seconds
from tf2_py.printable import printable

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped


class Hop(NamedTuple):
    """
    One hop of an explained lookup: a frame, its parent, and the samples that have answered.

    ``frame`` and ``parent``: their names. ``direction``: ``"up"``, from the frame to its parent, or
    ``"down"``, from the parent to the frame, by the inverse of the transform.

    ``how`` the frame has answered:

    - ``"static"``: it has one transform, for all times.
    - ``"sample"``: a sample has the time of the lookup.
    - ``"interpolated"``: between the samples on both sides of the time.
    - ``"kept"``: the sample before the time, because the sample after it has another parent.
    - ``"held"``: the newest sample, because of a ``tolerance``.
    - ``"extrapolated"``: from the last two samples, because of a ``tolerance`` with ``extrapolate``.

    ``older_ns`` and ``newer_ns``: the stamps of the samples before and after the time, in nanoseconds, or of
    the last two if extrapolated; equal if a single sample has answered; None for a static frame. ``weight``:
    the weight of the newer sample, from 0 to 1, or above 1 if extrapolated; 0 if one sample has answered.

    ``gap``: how far the samples around the time are apart, in seconds, or for a held or extrapolated frame,
    how far the time is after its newest sample; otherwise 0. ``age``: how old the newest sample of the frame
    is on the clock of the buffer, in seconds, as from :meth:`tf2_py.BufferCore.ages`; None for a static frame
    or without a clock. ``last_authority``: the authority of the last transform that was inserted for this
    frame, which need not be that of these samples.

    ``transform``: a ``geometry_msgs/TransformStamped``, the pose of the frame in its parent; meters, unit
    quaternion. Its stamp is the time of the lookup, or the stamp of a held sample.

    >>> from tf2_py import BufferCore
    >>> from geometry_msgs.msg import TransformStamped
    >>> robot = TransformStamped(child_frame_id="base_link")
    >>> robot.header.frame_id = "odom"
    >>> buffer = BufferCore()
    >>> for robot.header.stamp.sec in (2, 3):
    ...     buffer.set_transform(robot, "wheels")
    >>> [hop] = buffer.explain("odom", "base_link", 2_400_000_000).hops
    >>> hop.how, hop.older_ns, hop.newer_ns, hop.weight, hop.gap
    ('interpolated', 2000000000, 3000000000, 0.4, 1.0)
    """

    frame: str
    parent: str
    direction: Literal["up", "down"]
    how: Literal["static", "sample", "interpolated", "kept", "held", "extrapolated"]
    older_ns: int | None
    newer_ns: int | None
    weight: float
    gap: float
    age: float | None
    last_authority: str
    transform: "TransformStamped"

    @property
    def static(self) -> bool:
        """Whether its transform is valid at all times."""
        return self.how == "static"

    def __str__(self) -> str:
        arrow, samples, gap, age, last_authority = self._facts()
        gap, age = gap and f" (gap {gap})", age and f", newest {age}"
        return f"{arrow}  {samples}{gap}{age}, last from {last_authority}"

    def _facts(self) -> tuple[str, str, str, str, str]:
        """What is shown of it; the gap and the age are empty where they have no meaning."""
        gap = "" if self.how in ("static", "sample") else _span(self.gap)
        return self._arrow(), self._samples(), gap, self._age(), printable(self.last_authority)

    def _arrow(self) -> str:
        begin, end = (self.frame, self.parent) if self.direction == "up" else (self.parent, self.frame)
        return f"{printable(end)} ← {printable(begin)}"

    def _samples(self) -> str:
        if self.older_ns is None or self.newer_ns is None:
            return "static"
        older, newer = (f"{ns / NS_PER_S:.3f}" for ns in (self.older_ns, self.newer_ns))
        weight = f"{100 * self.weight:.0f} %"
        if self.how == "interpolated":
            return f"interpolated {weight} between {older} and {newer} s"
        if self.how == "kept":
            return f"kept from {older} s, because the sample at {newer} s has another parent"
        if self.how == "held":
            return f"held from its newest sample at {newer} s"
        if self.how == "extrapolated":
            return f"extrapolated {weight} of {older} to {newer} s"
        return f"sample at {newer} s"

    def _age(self) -> str:
        if self.age is None:
            return ""
        return f"{_span(self.age)} old" if math.isfinite(self.age) else "of unknown age"


def _span(seconds: float) -> str:
    """How long, with a sign, but none for what rounds to 0."""
    return in_days(round(seconds * NS_PER_S)) or f"{round(seconds, 3) + 0.0:.3f} s"


class Explanation(NamedTuple):
    """
    Why a lookup has its answer. See :meth:`tf2_py.BufferCore.explain`; ``print`` shows one line for each hop.

    ``transform``: the answer, a ``geometry_msgs/TransformStamped``. ``time_ns``: the time of the lookup in
    nanoseconds; for the time 0, the latest common time. ``hops``: a list of :class:`Hop`, from the source
    frame up to the common ancestor, then down to the target frame. Composed, their transforms are the
    answer.

    >>> from tf2_py import BufferCore
    >>> from geometry_msgs.msg import TransformStamped
    >>> robot = TransformStamped(child_frame_id="base_link")
    >>> robot.header.frame_id = "odom"
    >>> buffer = BufferCore()
    >>> for robot.header.stamp.sec in (2, 3):
    ...     buffer.set_transform(robot, "wheels")
    >>> found = buffer.explain("odom", "base_link", 0)
    >>> found.time_ns, [(hop.frame, hop.how) for hop in found.hops]
    (3000000000, [('base_link', 'sample')])
    """

    transform: "TransformStamped"
    time_ns: int
    hops: list[Hop]

    @property
    def weakest(self) -> Hop | None:
        """The hop with the largest gap or age, the first of equal ones; None if no frame moves."""
        moving = [hop for hop in self.hops if not hop.static]
        return max(moving, key=lambda hop: max(hop.gap, hop.age or 0.0), default=None)

    def _title(self) -> str:
        header, child = self.transform.header, self.transform.child_frame_id
        return f"{printable(header.frame_id)} ← {printable(child)} at {seconds(self.time_ns)}"

    def __str__(self) -> str:
        lines = [self._title(), *(f"  {hop}" for hop in self.hops)]
        weakest = self.weakest
        return "\n".join(lines if weakest is None else [*lines, f"weakest: {weakest._arrow()}"])

    def _repr_html_(self) -> str:
        """As a table, for notebooks: the weakest hop is bold; those after their newest sample are red."""
        heads = ("hop", "answer", "gap", "newest sample", "last from")
        rows = [f"<tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr>"]
        weakest = self.weakest
        for hop in self.hops:
            marks = ["color: #D55E00"] if hop.how in ("held", "extrapolated") else []
            marks += ["font-weight: bold"] if hop is weakest else []
            style = f' style="{"; ".join(marks)}"' if marks else ""
            cells = "".join(f"<td>{escape(fact)}</td>" for fact in hop._facts())
            rows.append(f"<tr{style}>{cells}</tr>")
        return f"<table><caption>{escape(self._title())}</caption>{''.join(rows)}</table>"


for _public in (Hop, Explanation):
    _public.__module__ = "tf2_py"
