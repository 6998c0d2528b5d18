"""`bench cite`: BibTeX of this program and of the paper, from `CITATION.cff`."""

from __future__ import annotations

import re
from pathlib import Path

from data_prep.files.safe_read import read_text

_SOURCE = Path(__file__).parents[1] / "CITATION.cff"  # a link to the file in the repository's root
_MOST_BYTES = 2**16  # the largest CITATION.cff that is read; the file has about 1,000 bytes


def cite() -> None:
    """Print BibTeX of this program and of the paper that it re-implements."""
    print(bibtex(read_text(_SOURCE, _MOST_BYTES)), end="")


def bibtex(citation: str) -> str:
    """Return the BibTeX of the text of this project's CITATION.cff: the program, then the paper."""
    _, program, paper = re.split("^(?:preferred-citation|references):$", citation, flags=re.M)
    first, last = _value(paper, "given-names"), _value(paper, "family-names")
    # Inner braces keep BibTeX from splitting a name that is no person's, and capitals in titles.
    of_program = {
        "author": f"{{{_value(program, 'name')}}}",
        "title": f"{{{_value(program, 'title')}}}",
        "year": _value(program, "year"),
        "note": f"Version {_value(program, 'version')}",
    }
    for url in _values(program, "repository-code"):  # none before the first release is published
        of_program["url"] = url
    of_paper = {
        "author": f"{last}, {first}",
        "title": f"{{{_value(paper, 'title')}}}",
        "booktitle": _value(paper, "collection-title"),
        "year": _value(paper, "year"),
    }
    return (
        f"@misc{{pc2pix-bench,\n{_fields(of_program)}}}\n\n"
        f"@inproceedings{{{last.lower()}-pc2pix,\n{_fields(of_paper)}}}\n"
    )


def _fields(values: dict[str, str]) -> str:
    return "".join(f"  {name} = {{{text}}},\n" for name, text in values.items())


def _value(section: str, name: str) -> str:
    """Return the value of the key `name`, which a section of CITATION.cff has once."""
    (text,) = _values(section, name)
    return text


def _values(section: str, name: str) -> list[str]:
    """Return all values of the key `name` in a section of CITATION.cff.

    A regular expression stands in for a YAML parser, which is no dependency; a test compares all
    values with those that a YAML parser reads.
    """
    values = re.findall(rf"^[ -]*\b{name}: *(?:>-\n *)?(.*)$", section, flags=re.M)
    return [text.strip('"') for text in values]
