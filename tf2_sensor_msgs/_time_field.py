# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the field with the times of a cloud's points, and what its numbers mean."""

from collections.abc import Iterable
from numbers import Real
from typing import NamedTuple

from sensor_msgs.msg import PointCloud2, PointField

from tf2_py._internal import duration_ns
from tf2_py.printable import printable
from tf2_py.typing import DurationLike
from tf2_sensor_msgs._errors import FieldError

S = 1_000_000_000
LONGEST_UNIT_NS = 3600 * S
NEARLY = 1e-12  # the rounding of a unit in seconds


class Unit(NamedTuple):
    """What the numbers in a field of times are."""

    ns: int
    is_absolute: bool  # since 1970; else after the stamp

    @property
    def text(self) -> str:
        name = {1: "ns", 1_000: "µs", 1_000_000: "ms", S: "s"}.get(self.ns, f"{self.ns / S:g} s")
        return f"{name} {'since 1970' if self.is_absolute else 'after the stamp'}"


# By datatype; NumPy's names, too.
NAMES = {
    getattr(PointField, name.upper()): name
    for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
}
# The fields that drivers of lidars write: Velodyne; Ouster; Livox; Hesai and Livox, in different units.
KNOWN = {
    "time": ((PointField.FLOAT32, PointField.FLOAT64), Unit(S, False)),
    "t": ((PointField.UINT32,), Unit(1, False)),
    "offset_time": ((PointField.UINT32,), Unit(1, False)),
    "timestamp": ((PointField.FLOAT64,), Unit(S, True)),
}


class TimeField(NamedTuple):
    """The field with the times of the points, as ``_deskew_points.pxi`` reads it."""

    name: str
    unit: Unit
    base_ns: int  # the time that 0 means
    wraps: bool  # a uint32 from 2^31 on is negative

    @property
    def unit_ns(self) -> int:
        return self.unit.ns

    def time_ns(self, number: float) -> int:
        whole = int(number)
        return self.base_ns + whole * self.unit.ns + round((number - whole) * self.unit.ns)


def _unit_ns(time_unit: DurationLike) -> int:
    unit_ns = duration_ns(time_unit, "time_unit")
    # A duration in seconds is cut off to whole ns, and 15e-9 s would be 14 ns.
    exact_ns = float(time_unit) * S if isinstance(time_unit, Real) else unit_ns
    if not 1 - NEARLY <= exact_ns <= LONGEST_UNIT_NS:
        raise ValueError(f"time_unit: expected 1e-9 to {LONGEST_UNIT_NS // S} s, got {exact_ns / S:.15g} s")
    if abs(exact_ns - round(exact_ns)) > NEARLY * exact_ns:
        raise ValueError(f"time_unit: expected whole nanoseconds, got {exact_ns:.10g} ns: pass times instead")
    return round(exact_ns)


def find_time_field(cloud: PointCloud2, stamp_ns: int, time_unit: DurationLike | None) -> TimeField:
    """The first of the known fields that a cloud has; ``time_unit``: what a 1 means, if that is said."""
    unit_ns = None if time_unit is None else _unit_ns(time_unit)
    datatypes = {field.name: field.datatype for field in reversed(list(cloud.fields))}
    for name, (accepted, unit) in KNOWN.items():
        datatype = datatypes.get(name, 0)
        takes_any = unit_ns is not None and not unit.is_absolute
        if datatype not in accepted and not (takes_any and datatype in NAMES):
            continue
        base_ns = 0 if unit.is_absolute else stamp_ns
        # Ouster's driver wrote the time of a point before the stamp as it is in 32 bits.
        wraps = datatype == PointField.UINT32 and datatype in accepted and unit_ns in (None, unit.ns)
        return TimeField(name, unit if unit_ns is None else unit._replace(ns=unit_ns), base_ns, wraps)
    found = _listed(f"{printable(field.name)} ({NAMES.get(field.datatype, '?')})" for field in cloud.fields)
    known = _listed(
        f"{name} ({' or '.join(NAMES[datatype] for datatype in accepted)})"
        for name, (accepted, _) in KNOWN.items()
    )
    raise FieldError(
        f"no field with the times of the points: expected one of {known}, but the cloud has {found}. If one "
        "of the first three has another type, pass time_unit; if the times are elsewhere, pass times"
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "no fields"
