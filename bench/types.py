"""Owns the section on `do_transform_*`: messages, clouds and arrays, beside NumPy and beside copying."""

from __future__ import annotations

from functools import partial

from bench.race import OURS, Entry, Run, Sample, sample_of

CALLS = 100_000


def types(run: Run) -> None:
    """One race for each type; who is `ours`, `numpy`, or a copy of what is transformed."""
    sizes = run.sizes

    def measure(who: str, name: str, labels: dict) -> list[Sample]:
        answer = process.ask("time", who, name, CALLS, sizes.types_budget_s)
        return [sample_of(answer, who, "call", labels)]

    with run.process("types_by_numpy.py") as process:
        for name, contenders in process.ask("types", sizes.points)["types"].items():
            run.say(f"types: {name}")
            labels = {"type": name}
            if name.startswith(("cloud", "array")):
                labels["points"] = sizes.points
            run.race("types", [Entry(OURS, partial(measure, who, name, labels)) for who in contenders])
