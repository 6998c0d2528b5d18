r"""Tables as LaTeX, for papers: the rules of `booktabs`, and ASCII alone.

Each grid becomes a `table` with caption and label. The texts that Markdown has above and below it
become comments. Below the values of a line stand their intervals, by a command that a paper may
define otherwise, `\benchvalue`, and a line of the published values. A grid that is too wide for the
text of `article` is set smaller, then turned, then divided into several tables.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from bench.tables.grid import BEST, MOVED, UNSURE, Block, Cell, Grid, meanings
from bench.tables.markdown import visible

PREAMBLE = r"""% \usepackage{booktabs} comes before this
% without intervals: \newcommand{\benchvalue}[3]{#1} before this
\ifdefined\extrafloats\extrafloats{200}\fi % for all tables together, without text between them
% table* spans both columns of a paper that has two, and is a table in a paper of one
\providecommand{\benchvalue}[3]{%
  \begin{tabular}[t]{@{}r@{}}#1\\[-3pt]{\scriptsize [#2, #3]}\rule[-5pt]{0pt}{0pt}\end{tabular}}
"""
_PUBLISHED = "paper: as published; other data (ShapeNet), other weights"
_BEST = "bold: the best of those that compete"
_LACKING = "in parentheses: how many images exist, of how many"
# Lengths in pt. The first two are \textwidth of `article` at 10 pt, and \columnwidth of the
# narrowest common style with two columns. The third is \textheight of `article` less a caption of
# three lines, the heads and four remarks.
_TEXT_WIDTH, _COLUMN_WIDTH, _LINES_HEIGHT = 345.0, 229.0, 430.0
_GAP = 6.0  # pt between two columns: twice \tabcolsep as it is set below
_WIDEST_TEXT = 100.0  # pt; a longer text in a cell is broken into lines
_LINE_HEIGHT = 11.0  # pt from one line of small type to the next
# How wide Computer Modern is in these sizes, in parts of its width at 10 pt.
_SIZES = {r"\small": 0.925, r"\footnotesize": 0.85}
_SCRIPT = 0.8  # the same of \scriptsize, in which intervals are set
_BOLD = 1.15  # how much wider its bold digits are
# Widths of its characters at 10 pt in pt, rounded up: digits and most letters have 5.1 or less.
_NARROW, _USUAL, _WIDE = 3.1, 5.1, 8.0
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
    """The LaTeX of a cell, with about how wide it is.

    width  in pt where the type has 10 pt
    fixed  the width in pt of what has the same size in any type
    """

    code: str
    width: float
    fixed: float = 0.0


_MISSING = _Text("-", _NARROW)
_PAPER = _Text(r"\quad paper", 7 * _USUAL)  # the name of a line of published values


@dataclass(frozen=True)
class _Lines:
    """The lines of a table, heads first; a line begins with its name, and with texts about it.

    keys  how many of its first texts tell a line from others, and stand in each part of a table
    """

    lines: tuple[tuple[_Text, ...], ...]
    keys: int = 1

    def turned(self) -> _Lines:
        return _Lines(tuple(zip(*self.lines, strict=True)))

    def widths(self, scale: float) -> list[float]:
        """Return the width of each column with the gap beside it, in pt."""
        widths = []
        for column in zip(*self.lines, strict=True):
            widths.append(max(max(scale * text.width, text.fixed) for text in column) + _GAP)
        return widths

    def width(self, scale: float) -> float:
        return sum(self.widths(scale)) - _GAP

    def parts(self, scale: float) -> Iterator[_Lines]:
        """Yield tables that are as wide and as high as a page at most, with all columns."""
        widths = self.widths(scale)
        room = _TEXT_WIDTH + _GAP - sum(widths[: self.keys])
        head, *lines = self.lines
        heights = []
        for line in lines:  # an interval, like a long text, takes a second line
            heights.append(_LINE_HEIGHT * (2 if any(text.fixed for text in line) else 1))
        for down in _slices(heights, _LINES_HEIGHT):
            for across in _slices(widths[self.keys :], room):
                columns = slice(self.keys + across.start, self.keys + across.stop)
                part = [(*line[: self.keys], *line[columns]) for line in (head, *lines[down])]
                shown = [line for line in part if line[0] != _PAPER or {*line[1:]} != {_MISSING}]
                yield _Lines(tuple(shown), self.keys)


def _slices(sizes: Sequence[float], most: float) -> Iterator[slice]:
    """Yield slices of neighbours whose sizes add up to `most` at most; one alone may be larger."""
    start, total = 0, 0.0
    for number, size in enumerate(sizes):
        if number > start and total + size > most:
            yield slice(start, number)
            start, total = number, 0.0
        total += size
    yield slice(start, len(sizes))


def _fitted(whole: _Lines) -> tuple[str, list[_Lines]]:
    """Return the size of type in which a table fits, turned where that helps, and its parts.

    Where nothing fits it is divided, in the smallest size.
    """
    turned = [whole.turned()] if whole.keys == 1 else []
    for lines in (whole, *turned):
        for size, scale in _SIZES.items():
            if lines.width(scale) <= _TEXT_WIDTH:
                return size, [*lines.parts(scale)]
    smallest = min(_SIZES, key=_SIZES.__getitem__)
    return smallest, [*whole.parts(_SIZES[smallest])]


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
        _LACKING if any(map(_lacks_images, cells)) else "",
        _BEST if any(cell.special is BEST for cell in cells) else "",
        _PUBLISHED if any(cell.paper for cell in cells) else "",
        *meanings(cells),
    ]
    texts = [tuple(map(_text, (grid.corner, *grid.columns)))]
    for line in lines:
        ours = [_MISSING if grid.void else _value(cell) for cell in line.cells]
        texts.append((_text(line.name), *ours))
        if any(cell.paper for cell in line.cells):
            texts.append((_PAPER, *_published(line.cells, digits)))
    size, parts = _fitted(_Lines(tuple(texts), 1 + grid.keys))
    for number, part in enumerate(parts, 1):
        several = len(parts) > 1
        caption = _caption(grid, title) + (f", part {number} of {len(parts)}" if several else "")
        environment = "table" if part.width(_SIZES[size]) <= _COLUMN_WIDTH else "table*"
        head, *rows = part.lines
        columns = "l" * part.keys + "r" * (len(head) - part.keys)
        yield "\n".join(
            [
                rf"\begin{{{environment}}}",
                r"\centering",
                rf"\caption{{{escaped(caption)}}}",
                rf"\label{{tab:{label}{f'-{number}' if several else ''}}}",
                rf"{size}\setlength{{\tabcolsep}}{{{_GAP / 2:g}pt}}",
                rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
                r"\toprule",
                _row(head),
                r"\midrule",
                *map(_row, rows),
                r"\bottomrule",
                r"\end{tabular}",
                *(rf"\par{{\footnotesize {escaped(text)}}}" for text in remarks if text),
                rf"\end{{{environment}}}",
                "",
            ]
        )


def _caption(grid: Grid, title: str) -> str:
    """Return the caption, without the number that a table has in the original paper."""
    about = re.sub(r"^Table \d+: ", "", title)
    for direction in (" (higher is better)", " (lower is better)"):
        if direction in grid.caption:  # which says it already
            about = about.replace(direction, "")
    return f"{grid.caption}; {about}"


def _row(texts: Iterable[_Text]) -> str:
    return " & ".join(text.code for text in texts) + r" \\"


def _published(cells: Sequence[Cell], digits: int) -> Iterator[_Text]:
    """Yield the paper's values of a line."""
    for cell in cells:
        yield _text(f"{float(cell.paper):.{digits}f}") if cell.paper else _MISSING


def _text(text: str) -> _Text:
    """Return a text, in several lines where it is long."""
    width = _width(text)
    if width > _WIDEST_TEXT and " " in text:
        code = rf"\parbox[t]{{{_WIDEST_TEXT:g}pt}}{{\raggedright {escaped(text)}\strut}}"
        return _Text(code, width, _WIDEST_TEXT)
    return _Text(escaped(text), width)


def _width(text: str) -> float:
    """Return about how wide a text is in Computer Modern at 10 pt, in pt."""
    widths = []
    for character in _with_minus(text):
        if character in " .,:;[]!'()ijlft|-":
            widths.append(_NARROW)
        elif character.isupper() or character in "mw@%+=<>\u2212\u2248\xd7\xb1":
            widths.append(_WIDE)
        elif character.isascii():
            widths.append(_USUAL)
        else:
            widths.append(_USUAL * len(_character(character)))
    return sum(widths)


def _lacks_images(cell: Cell) -> bool:
    return cell.count is not None and cell.count[0] < cell.count[1]


def _value(cell: Cell) -> _Text:
    """Return the value as Markdown has it, with the number of images only where some failed."""
    layout = cell.special.markdown if cell.special else "{value}{interval}"
    before, after = layout.partition("{value}")[0], layout.partition("{interval}")[2]
    rest = after.replace("*", "")
    if cell.count is not None and _lacks_images(cell):
        rest += " ({}/{})".format(*cell.count)
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
    fixed = _SCRIPT * _width("[{}, {}]".format(*cell.interval))
    return _Text(rf"\benchvalue{{{code}}}{{{low}}}{{{high}}}", width, fixed)
