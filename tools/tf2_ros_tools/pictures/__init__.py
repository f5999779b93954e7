"""Draw what other modules compute, as pictures and on a terminal."""

__all__: list[str] = []
