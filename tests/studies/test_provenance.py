"""Numbers of the documentation, and where they come from."""

from __future__ import annotations

import pytest

from studies.documents import PAGES
from studies.provenance import SETTINGS, origins

TABLE = "<!-- numbers: x.csv rows=a:b columns=c:d -->\n| .5 | 1.25 |\n<!-- end -->\n"


@pytest.mark.parametrize(
    ("text", "counts", "unknown"),
    [
        ("# A\n\nTwo chairs and 20 views.\n", {}, []),
        (f"# A\n\n{TABLE}", {"generated": 2}, []),
        (f"# A\n\n{TABLE}\nBy .25.\n", {"generated": 2, "unknown": 1}, [1]),
        ("# A\n\nBy .25. Measured 2026-11-22,\n3c16b67.\n", {"measured": 1}, []),
        (f"# A\n{SETTINGS}\n\nBy .25 or 0.3.\n", {"setting": 2}, []),
        # a section speaks for itself alone
        ("# A\n\nMeasured 2026-11-22, 3c16b67.\n\n## B\n\nBy .25.\n", {"unknown": 1}, [5]),
        # code, links and conditions are no numbers, and comments in code no headings
        ("# A\n\n`0.5`, [1](x-0.5.md), noise-0.05\n\n```\n# 0.5\n```\n", {}, []),
        ("# A\n\n```\n# 0.5\n```\n\n## B\n\n.5\n", {"unknown": 1}, [7]),
    ],
)
def test_origins(text, counts, unknown):
    by_origin, lines = origins(text)
    assert {origin: count for origin, count in by_origin.items() if count} == counts
    assert lines == unknown


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_number_of_a_page_has_an_origin(path):
    """If this fails, say when and at which commit it was measured, or that it is a setting."""
    assert origins(path.read_text(encoding="utf-8"))[1] == []
