"""Owns what an owner tells of itself, beside its transforms."""

import json
from dataclasses import asdict, dataclass, field

__all__ = ["Description", "read_description"]


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
        """As JSON."""
        return json.dumps(asdict(self)).encode()


def read_description(text: bytes) -> Description | None:
    """Read what `Description.to_bytes` made; None: it is nothing of that kind."""
    try:
        return Description(**json.loads(text))
    except (TypeError, ValueError):
        return None
