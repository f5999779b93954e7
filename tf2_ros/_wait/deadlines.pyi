import weakref
from typing import Any

class Deadlines:
    @property
    def entries(self) -> list[tuple[int, int, weakref.ref[Any]]]: ...
    def begin_anew(self) -> None: ...
    def add(self, deadline_ns: int, wait: Any) -> None: ...

deadlines: Deadlines
