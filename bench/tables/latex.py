r"""Tables as LaTeX, for papers: the rules of `booktabs`, and ASCII alone.

Each grid is a `table` with caption and label. What Markdown has above and below it are comments.
Published values stand in a column beside ours. Intervals are a command, `\benchci`.
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
_COMMANDS = {
    **{mark: f"\\{mark}" for mark in "_%&#$"},
    **{mark: f"{{{mark}}}" for mark in "[*"},  # which are options where they follow \\
    **{"{": r"\{", "}": r"\}", "\\": r"\textbackslash{}", "~": r"\textasciitilde{}"},
    **{"^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}"},
    **{
        "|": r"\textbar{}",
        '"': "''",
        "`": r"\`{}",
        MOVED: r"$\approx$",
        UNSURE: r"$\dagger$",
        "−": "$-$",
    },
    **{"–": "--", "—": "---", "…": r"\ldots{}", "×": r"$\times$", "±": r"$\pm$"},
    **{"°": r"$^\circ$", "≤": r"$\le$", "≥": r"$\ge$", "’": "'", "“": "``", "”": "''"},
}


def escaped(text: str) -> str:
    """Return LaTeX that shows a text; a character that LaTeX lacks by its number."""
    text = re.sub(r"(?<![^\s\[(])-(?=\.?\d)", "−", visible(text))  # before a number
    # Two hyphens would be a dash.
    return re.sub("-(?=-)", "-{}", "".join(map(_character, text)))


def _character(character: str) -> str:
    unknown = character if character.isascii() else f"{{[}}U+{ord(character):04X}]"
    return _COMMANDS.get(character, unknown)


def document(name: str, title: str, blocks: Iterable[Block]) -> str:
    """Return the blocks of a table: the grids that a report shows, other blocks as comments."""
    parts, texts = [_comment(title)], list[str]()
    for block in blocks:
        if isinstance(block, str):
            texts += [block] * (bool(block) and not block.startswith("#"))
        elif block.caption:
            about = f"{block.caption}: " * block.void  # of a grid that is not shown
            notes = (f"{about}{note}" for note in block.notes)
            comments = [_comment(text) for text in (*texts, *notes)]
            tables = [] if block.void else [_table(block, f"{name}-{len(parts)}", title)]
            parts.append("".join((*comments, *tables)))
            texts = []
        else:  # in the paper's layout, where the paper's values are lines
            texts = texts[:-1]
    return "\n".join((*parts, *map(_comment, texts)))


def _comment(text: str) -> str:
    lines = text.encode("ascii", "backslashreplace").decode().splitlines()
    return "".join(f"% {line.rstrip()}\n" for line in lines)


def _table(grid: Grid, label: str, title: str) -> str:
    cells = [cell for line in grid.lines for cell in line.cells]
    # The paper prints all values of a metric with as many digits, `Cell.paper` none that is 0.
    digits = max(len(cell.paper.partition(".")[2]) for cell in cells) if cells else 0
    published = [any(line.cells[i].paper for line in grid.lines) for i in range(len(grid.columns))]
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
        rf"\begin{{tabular}}{{l{'r' * (len(published) + sum(published))}}}",
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
    """Yield the line of the columns' names, and one below where published values stand beside."""
    heads, below, rules, column = [escaped(grid.corner)], [""], list[str](), 2
    for name, beside in zip(map(escaped, grid.columns), published, strict=True):
        heads.append(rf"\multicolumn{{2}}{{c}}{{{name}}}" if beside else name)
        below += ["ours", "paper"] if beside else [""]
        rules += [rf"\cmidrule(lr){{{column}-{column + 1}}}"] * beside
        column += 1 + beside
    yield _row(heads)
    if rules:
        yield from ("".join(rules), _row(below))


def _row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _values(cells: Sequence[Cell], published: Sequence[bool], digits: int) -> Iterator[str]:
    for cell, beside in zip(cells, published, strict=True):
        yield _value(cell)
        if beside:
            yield f"{float(cell.paper):.{digits}f}" if cell.paper else "-"


def _value(cell: Cell) -> str:
    """Return the value as Markdown has it, but how many images it has only where some failed."""
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
