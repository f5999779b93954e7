"""Owns what an owner tells of itself, beside its transforms."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = ["Description", "read_description"]

MOST_BYTES = 3000  # what a segment has room for is a little more


@dataclass
class Description:
    """What those who attach want to know of an owner."""

    process: int
    program: str
    cache_time_ns: int
    domain: int | None = None  # of its listener; None: it has none
    topics: list[str] = field(default_factory=list)  # that its listeners receive
    simulated: bool = False  # whether it follows simulated time

    def to_bytes(self) -> bytes:
        """As JSON; of more topics than there is room for, not all are told."""
        facts = asdict(self)
        while len(text := json.dumps(facts).encode()) > MOST_BYTES and facts["topics"]:
            facts["topics"].pop()
        return text


def read_description(text: bytes) -> Description | None:
    """Read what `Description.to_bytes` made; None: it is nothing of that kind."""
    try:
        read = Description(**json.loads(text))
    except (TypeError, ValueError):
        return None
    return read if _is_sound(read) else None


def _is_sound(read: Description) -> bool:
    def is_int(value: Any) -> bool:
        return isinstance(value, int) and not isinstance(value, bool)

    return (
        is_int(read.process)
        and is_int(read.cache_time_ns)
        and (read.domain is None or is_int(read.domain))
        and isinstance(read.program, str)
        and isinstance(read.simulated, bool)
        and isinstance(read.topics, list)
        and all(isinstance(topic, str) for topic in read.topics)
    )
