"""Owns the table of findings of many recordings, as files."""

import os
from collections.abc import Sequence
from dataclasses import fields
from io import BytesIO

from tf2_ros._recordings.mapping import Row
from tf2_ros._whole_files import write_whole

__all__ = ["write_findings"]

# Readers of folders leave out names that begin so: the other files have other columns.
PARQUET, TEXT = "_findings.parquet", "_findings.txt"


def write_findings(out: str, rows: Sequence[Row]) -> str:
    """
    Write the rows into a folder, for programs and for people.

    :return: the path of the Parquet file.
    """
    import pyarrow
    from pyarrow import parquet

    text, whole, real = pyarrow.string(), pyarrow.int64(), pyarrow.float64()
    types = {"transforms": whole, "rows": whole, "valid": whole, "span_s": real, "seconds": real}
    names = [one.name for one in fields(Row)]
    columns = {name: [getattr(row, name) for row in rows] for name in names}
    schema = pyarrow.schema([(name, types.get(name, text)) for name in names])
    written = BytesIO()
    parquet.write_table(pyarrow.table(columns, schema), written)
    path = os.path.join(out, PARQUET)
    write_whole(path, written.getvalue())
    write_whole(os.path.join(out, TEXT), "".join(_lines(rows)).encode())
    return path


def _lines(rows: Sequence[Row]) -> list[str]:
    lines, file = [], None
    for row in rows:
        if row.file != file:
            lines.append(f"{row.file}\n")
            file = row.file
        frame = f" {row.frame}:" if row.frame else ""
        lines.append(f"  {row.kind}:{frame} {row.text}\n")
    return lines
