from __future__ import annotations

import re
from pathlib import Path

from data_prep.datasets.protocol_version import CHANGES, PROTOCOL_VERSION

PAGE = Path(__file__).parents[3] / "docs" / "protocol.md"


def test_the_versions_are_numbered_from_one() -> None:
    assert [*CHANGES] == [*range(1, PROTOCOL_VERSION + 1)]


def test_the_page_lists_the_versions_and_names_the_last() -> None:
    text = PAGE.read_text(encoding="utf-8")
    section = text.partition("## What changed between versions\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (\d+) \| (.+) \|$", section, re.MULTILINE)
    assert {int(version): changes for version, changes in rows} == CHANGES
    assert f"This is version {PROTOCOL_VERSION} of the protocol" in text
