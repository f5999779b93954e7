"""The programs, each a module with a main()."""

__all__: list[str] = []
