r"""Tables as LaTeX, for papers: the rules of `booktabs`, and ASCII alone.

Each grid becomes a `table` with caption and label. The texts that Markdown has above and below it
become comments. Published values stand in a column beside ours. Intervals are written by a command,
`\benchci`, which a paper may define otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from bench.tables.grid import BEST, MOVED, UNSURE, Block, Cell, Grid, meanings
from bench.tables.markdown import visible

PREAMBLE = r"""% \usepackage{booktabs}; without intervals: \newcommand{\benchci}[2]{} before this
\providecommand{\benchci}[2]{ {\scriptsize [#1, #2]}}
"""
_PUBLISHED = "paper: as published; other data (ShapeNet), other weights"
_BEST = "bold: the best of those that compete"
_COMMANDS = {  # the LaTeX of a character
    "_": r"\_",
    "%": r"\%",
    "&": r"\&",
    "#": r"\#",
    "$": r"\$",
    "[": "{[}",  # after a line break LaTeX would take brackets and stars as options
    "*": "{*}",
    "{": r"\{",
    "}": r"\}",
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': "''",
    "`": r"\`{}",
    MOVED: r"$\approx$",
    UNSURE: r"$\dagger$",
    "−": "$-$",
    "–": "--",
    "—": "---",
    "…": r"\ldots{}",
    "×": r"$\times$",
    "±": r"$\pm$",
    "°": r"$^\circ$",
    "≤": r"$\le$",
    "≥": r"$\ge$",
    "’": "'",
    "“": "``",
    "”": "''",
}


def escaped(text: str) -> str:
    """Return LaTeX that shows a text; a character beyond ASCII without a command as its number."""
    text = re.sub(r"(?<![^\s\[(])-(?=\.?\d)", "−", visible(text))  # minus signs of numbers
    # Between two hyphens stands an empty group, as LaTeX would make them one dash.
    return re.sub("-(?=-)", "-{}", "".join(map(_character, text)))


def _character(character: str) -> str:
    unknown = character if character.isascii() else f"{{[}}U+{ord(character):04X}]"
    return _COMMANDS.get(character, unknown)


def document(name: str, title: str, blocks: Iterable[Block]) -> str:
    """Return the blocks of a table as LaTeX: the grids that a report shows, texts as comments.

    name  of the table, which begins the labels of its grids
    """
    parts, texts = [_comment(title)], list[str]()
    for block in blocks:
        if isinstance(block, str):
            if block and not block.startswith("#"):
                texts.append(block)
        elif block.caption:
            notes = list(block.notes)
            if block.void:  # no grid has this caption then
                notes = [f"{block.caption}: {note}" for note in notes]
            part = "".join(map(_comment, (*texts, *notes)))
            if not block.void:
                part += _table(block, f"{name}-{len(parts)}", title)
            parts.append(part)
            texts = []
        else:
            # A grid in the paper's layout is left out together with the text above it: here the
            # paper's values stand in columns.
            texts = texts[:-1]
    return "\n".join((*parts, *map(_comment, texts)))


def _comment(text: str) -> str:
    """Return a text as lines of a comment, in ASCII."""
    lines = text.encode("ascii", "backslashreplace").decode().splitlines()
    return "".join(f"% {line.rstrip()}\n" for line in lines)


def _table(grid: Grid, label: str, title: str) -> str:
    """Return a grid as a table with caption and label."""
    cells = [cell for line in grid.lines for cell in line.cells]
    # The paper prints all values of a metric with the same number of digits. `Cell.paper` has lost
    # the zeros at the end of some, so that the longest one tells the number.
    digits = max((len(cell.paper.partition(".")[2]) for cell in cells), default=0)
    published = []  # by column, whether the paper has a value in it
    for number in range(len(grid.columns)):
        published.append(any(line.cells[number].paper for line in grid.lines))
    columns = "l" + "r" * (len(published) + sum(published))
    remarks = [
        grid.remark,
        f"in brackets: {grid.interval}" if any(cell.interval for cell in cells) else "",
        _BEST if any(cell.special is BEST for cell in cells) else "",
        _PUBLISHED if any(published) else "",
        *meanings(cells),
    ]
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{escaped(f'{grid.caption}. {title}')}}}",
        rf"\label{{tab:{label}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        *_heads(grid, published),
        r"\midrule",
        *(
            _row([escaped(line.name), *_values(line.cells, published, digits)])
            for line in grid.lines
        ),
        r"\bottomrule",
        r"\end{tabular}",
        *(rf"\par{{\footnotesize {escaped(text)}}}" for text in remarks if text),
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _heads(grid: Grid, published: Sequence[bool]) -> Iterator[str]:
    """Yield the names of the columns, and "ours" and "paper" below those with published values."""
    heads, below, rules = [escaped(grid.corner)], [""], list[str]()
    column = 2  # of LaTeX, which counts from 1; the first has the names of the lines
    for name, has_paper in zip(map(escaped, grid.columns), published, strict=True):
        if has_paper:
            heads.append(rf"\multicolumn{{2}}{{c}}{{{name}}}")
            below += ["ours", "paper"]
            rules.append(rf"\cmidrule(lr){{{column}-{column + 1}}}")
            column += 2
        else:
            heads.append(name)
            below.append("")
            column += 1
    yield _row(heads)
    if rules:
        yield from ("".join(rules), _row(below))


def _row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _values(cells: Sequence[Cell], published: Sequence[bool], digits: int) -> Iterator[str]:
    """Yield the values of a line, each with the paper's where its column has published ones."""
    for cell, has_paper in zip(cells, published, strict=True):
        yield _value(cell)
        if has_paper:
            yield f"{float(cell.paper):.{digits}f}" if cell.paper else "-"


def _value(cell: Cell) -> str:
    """Return the value as Markdown has it, with the number of images only where some failed."""
    layout = cell.special.markdown if cell.special else "{value}{interval}"
    before, after = layout.partition("{value}")[0], layout.partition("{interval}")[2]
    text = escaped(cell.text)
    if cell.special is BEST or before:
        text = rf"\text{'it' if before == '*' else 'bf'}{{{text}}}"
    if cell.interval:
        text += r"\benchci{{{}}}{{{}}}".format(*map(escaped, cell.interval))
    text += escaped(after.replace("*", ""))
    if cell.count is not None and cell.count[0] < cell.count[1]:
        text += " ({}/{} images)".format(*cell.count)
    return text + escaped(cell.rest)
