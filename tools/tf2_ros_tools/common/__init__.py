"""Parse command lines, format output, read files and report missing libraries, for all other folders."""

__all__: list[str] = []
