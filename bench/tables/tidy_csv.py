"""CSV as scripts read it: a header, then a row for each value, raw."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable


def csv_text(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Rows that end with a line feed; what holds a line break of any kind is quoted."""
    return "".join(map(_row, (header, *rows)))


def _row(values: Iterable[object]) -> str:
    # The module quotes only the characters of its own line end, and readers stop at either.
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\r\n").writerow(values)
    return buffer.getvalue().removesuffix("\r\n") + "\n"
