"""A check that version and date are the same in all files; it is the first step of `make release`.

    python -m studies.release

It prints the version. Where something differs it prints what and in which file, and ends with
status 1.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

from bench.commands.cite import bibtex

REPOSITORY = Path(__file__).parents[1]
UNRELEASED = "unreleased"  # stands in place of the date before a release
_SECTION = re.compile(rf"^## \[(\d+\.\d+\.\d+)\] - (\d{{4}}-\d\d-\d\d|{UNRELEASED})$", re.M)


def version_of(folder: Path) -> str:
    """Return the version that `pyproject.toml` in a folder states."""
    return tomllib.loads(_read(folder, "pyproject.toml"))["project"]["version"]


def differences(folder: Path) -> list[str]:
    """Return messages about files in a folder with another version or date.

    The version is that of `pyproject.toml`, and the date that of `CITATION.cff`.
    """
    version, citation = version_of(folder), _read(folder, "CITATION.cff")
    (date,) = re.findall("^date-released: (.*)$", citation, re.M)
    year = re.findall("^  year: (.*)$", citation, re.M)
    sections = dict(_SECTION.findall(_read(folder, "CHANGELOG.md")))  # dates by version
    wrong = []
    for cited in re.findall("^ *version: (.*)$", citation, re.M):
        if cited != version:
            wrong.append(f"CITATION.cff: version {cited}, not {version}")
    if year != [date[:4]]:
        wrong.append(f"CITATION.cff: the year is {', '.join(year)}, the date {date}")
    if bibtex(citation) not in _read(folder, "README.md"):
        wrong.append("README.md: its BibTeX is not that of CITATION.cff")
    if sections.get(version) != date:
        wrong.append(f"CHANGELOG.md: no section '## [{version}] - {date}'")
    for earlier, its_date in list(sections.items())[1:]:
        if its_date == UNRELEASED:
            wrong.append(f"CHANGELOG.md: {earlier} is older, and {UNRELEASED}")
    return [f"{line}; make version VERSION={version}" for line in wrong]


def _read(folder: Path, name: str) -> str:
    return (folder / name).read_text("utf-8")


def main() -> None:
    """Print the version, or the differences."""
    if wrong := differences(REPOSITORY):
        sys.exit("\n".join(wrong))
    print(f"version {version_of(REPOSITORY)}, the same everywhere")


if __name__ == "__main__":
    main()
