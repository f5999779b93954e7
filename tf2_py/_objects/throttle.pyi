from collections.abc import Hashable

class Throttle:
    def passes(self, what: Hashable) -> bool: ...
