r"""Tables as LaTeX, for papers: the rules of `booktabs`, and ASCII alone.

Each grid becomes a `table` with caption and label. The texts that Markdown has above and below it
become comments. Below the values of a line stand their intervals, by a command that a paper may
define otherwise, `\benchvalue`, and a line of the published values. A grid that is too wide for the
text of `article` is turned, or divided into several tables.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from bench.tables.grid import BEST, MOVED, UNSURE, Block, Cell, Grid, meanings
from bench.tables.markdown import visible

PREAMBLE = r"""% \usepackage{booktabs} comes before this
% without intervals: \newcommand{\benchvalue}[3]{#1} before this
\ifdefined\extrafloats\extrafloats{200}\fi\maxdeadcycles=300 % where no text is between tables
% table* spans both columns of a paper that has two, and is a table in a paper of one
\providecommand{\benchvalue}[3]{%
  \begin{tabular}[t]{@{}r@{}}#1\\[-3pt]{\scriptsize [#2, #3]}\rule[-5pt]{0pt}{0pt}\end{tabular}}
"""
_PUBLISHED = "paper: as published; other data (ShapeNet), other weights"
_BEST = "bold: the best of those that compete"
# Lengths in pt: \textwidth of `article` at 10 pt, and its \textheight less caption and remarks.
_TEXT_WIDTH, _LINES_HEIGHT = 345.0, 430.0
_GAP = 6.0  # pt between two columns: twice \tabcolsep as it is set below
_WIDEST_TEXT = 100.0  # pt; a longer text in a cell is broken into lines
_LINE_HEIGHT = 11.0  # pt from one line of small type to the next
# Widths of Computer Modern at \footnotesize in pt, rounded up. Digits and most letters are usual.
_NARROW, _USUAL, _WIDE = 2.7, 4.4, 6.8
_SCRIPT, _BOLD = 0.94, 1.15  # how wide \scriptsize, which intervals have, and bold digits are
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
    # Between two hyphens stands an empty group, as LaTeX would make them one dash.
    return re.sub("-(?=-)", "-{}", "".join(map(_character, _with_minus(text))))


def _with_minus(text: str) -> str:
    """Return the visible characters of a text, with the minus signs of its numbers."""
    return re.sub(r"(?<![^\s\[(])-(?=\.?\d)", "−", visible(text))


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
            if block.void:  # no other text has this caption then
                notes = [f"{block.caption}: {note}" for note in notes]
            part = "".join(map(_comment, (*texts, *notes)))
            parts.append(part + "".join(_tables(block, f"{name}-{len(parts)}", title)))
            texts = []
        else:
            # A grid in the paper's layout is left out together with the text above it: here the
            # paper's values stand below ours.
            texts = texts[:-1]
    return "\n".join((*parts, *map(_comment, texts)))


def _comment(text: str) -> str:
    """Return a text as lines of a comment, in ASCII."""
    lines = text.encode("ascii", "backslashreplace").decode().splitlines()
    return "".join(f"% {line.rstrip()}\n" for line in lines)


class _Text(NamedTuple):
    """The LaTeX of a cell, about how wide it is in pt, and how many lines it takes."""

    code: str
    width: float
    lines: int = 1


_Row = tuple[_Text, ...]
_MISSING = _Text("-", _NARROW)
_PAPER = _Text(r"\quad paper", 7 * _USUAL)  # the name of a line of published values
_CLOSER = 4  # pt by which such a line is nearer to the line above it, to which it belongs


def _widths(rows: Sequence[_Row]) -> list[float]:
    """Return the width of each column with the gap beside it, in pt."""
    return [max(text.width for text in column) + _GAP for column in zip(*rows, strict=True)]


def _parts(rows: Sequence[_Row], keys: int) -> Iterator[list[_Row]]:
    """Yield a table as it is or turned, whichever fits, or parts of it that fit.

    rows  the rows of the table, heads first
    keys  how many of the first texts of a row tell it from others; each part has them
    """
    room = _TEXT_WIDTH + _GAP
    turned = [*zip(*rows, strict=True)]
    if keys == 1 and sum(_widths(rows)) > room >= sum(_widths(turned)):
        rows = turned
    widths = _widths(rows)
    head, *lines = rows
    heights = [_LINE_HEIGHT * max(text.lines for text in line) for line in lines]
    for down in _slices(heights, _LINES_HEIGHT):
        for across in _slices(widths[keys:], room - sum(widths[:keys])):
            columns = slice(keys + across.start, keys + across.stop)
            part = [(*line[:keys], *line[columns]) for line in (head, *lines[down])]
            yield [line for line in part if line[0] != _PAPER or {*line[1:]} != {_MISSING}]


def _slices(sizes: Sequence[float], most: float) -> Iterator[slice]:
    """Yield slices of neighbours whose sizes add up to `most` at most; one alone may be larger."""
    start, total = 0, 0.0
    for number, size in enumerate(sizes):
        if number > start and total + size > most:
            yield slice(start, number)
            start, total = number, 0.0
        total += size
    yield slice(start, len(sizes))


def _tables(grid: Grid, label: str, title: str) -> Iterator[str]:
    """Yield a grid as tables with captions and labels; of a void grid the published values."""
    lines = [line for line in grid.lines if not grid.void or any(c.paper for c in line.cells)]
    if not lines:
        return
    cells = [cell for line in lines for cell in line.cells]
    # The paper prints all values of a metric with the same number of digits. `Cell.paper` has lost
    # the zeros at the end of some, so that the longest one tells the number.
    digits = max((len(cell.paper.partition(".")[2]) for cell in cells), default=0)
    remarks = [
        grid.remark,
        *(grid.notes if grid.void else ()),
        f"in brackets: {grid.interval}" if any(cell.interval for cell in cells) else "",
        _BEST if any(cell.special is BEST for cell in cells) else "",
        _PUBLISHED if any(cell.paper for cell in cells) else "",
        *meanings(cells),
    ]
    rows = [tuple(map(_text, (grid.corner, *grid.columns)))]
    for line in lines:
        ours = [_MISSING if grid.void else _value(cell) for cell in line.cells]
        rows.append((_text(line.name), *ours))
        if any(cell.paper for cell in line.cells):
            texts = [f"{float(c.paper):.{digits}f}" if c.paper else "-" for c in line.cells]
            rows.append((_PAPER, *map(_text, texts)))
    # Without the table's number in the original paper, and what the grid's caption says, too.
    about = re.sub(r"^Table \d+: | \((higher|lower) is better\)", "", title)
    keys = 1 + grid.keys
    parts = [*_parts(rows, keys)]
    for number, (head, *body) in enumerate(parts, 1):
        caption, tag = f"{grid.caption}; {about}", label
        if len(parts) > 1:
            caption, tag = f"{caption}, part {number} of {len(parts)}", f"{label}-{number}"
        columns = "".join("l" if number < keys else "r" for number in range(len(head)))
        yield "\n".join(
            [
                r"\begin{table*}",
                r"\centering",
                rf"\caption{{{escaped(caption)}}}",
                rf"\label{{tab:{tag}}}",
                rf"\footnotesize\setlength{{\tabcolsep}}{{{_GAP / 2:g}pt}}",
                rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
                r"\toprule",
                _row(head),
                r"\midrule",
                *(
                    _of_paper(_row(line)) if line[0] == _PAPER and not grid.void else _row(line)
                    for line in body
                ),
                r"\bottomrule",
                r"\end{tabular}",
                *(rf"\par{{\footnotesize {escaped(text)}}}" for text in remarks if text),
                r"\end{table*}",
                "",
            ]
        )


def _row(texts: _Row) -> str:
    return " & ".join(text.code for text in texts) + r" \\"


def _of_paper(row: str) -> str:
    """Return a row of published values nearer to the row above, whose intervals leave room."""
    return f"\\addlinespace[-{_CLOSER}pt]\n{row}\n\\addlinespace[{_CLOSER}pt]"


def _text(text: str) -> _Text:
    """Return a text, in several lines where it is long."""
    width = _width(text)
    if width > _WIDEST_TEXT and " " in text:
        code = rf"\parbox[t]{{{_WIDEST_TEXT:g}pt}}{{\raggedright {escaped(text)}\strut}}"
        return _Text(code, _WIDEST_TEXT, 1 + int(width / _WIDEST_TEXT))
    return _Text(escaped(text), width)


def _width(text: str) -> float:
    """Return about how wide a text is in Computer Modern in small type, in pt."""
    text = _with_minus(text)
    narrow = len(re.findall(r"[ .,:;!'()\[\]ijlft|-]", text))
    wide = len(re.findall("[A-Zmw@%+=<>−≈×±]", text))
    return _NARROW * narrow + _WIDE * wide + _USUAL * (len(text) - narrow - wide)


def _value(cell: Cell) -> _Text:
    """Return the value as Markdown has it, with the number of images only where some failed."""
    layout = cell.special.markdown if cell.special else "{value}{interval}"
    before, after = layout.partition("{value}")[0], layout.partition("{interval}")[2]
    rest = after.replace("*", "")
    if cell.count is not None and cell.count[0] < cell.count[1]:
        rest += " ({}/{} images)".format(*cell.count)
    rest += cell.rest
    if cell.value is None and not rest:
        return _text(cell.text)
    code, width = escaped(cell.text), _BOLD * _width(cell.text) + _width(rest)
    if cell.special is BEST or before:
        code = rf"\text{'it' if before == '*' else 'bf'}{{{code}}}"
    code += escaped(rest)
    if not cell.interval:
        return _Text(code, width)
    low, high = map(escaped, cell.interval)
    below = _SCRIPT * _width("[{}, {}]".format(*cell.interval))
    return _Text(rf"\benchvalue{{{code}}}{{{low}}}{{{high}}}", max(width, below), 2)
