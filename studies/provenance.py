"""Origins of the numbers of the documentation: a command, a dated measurement, a setting.

A number is one with a decimal point, outside code. Between the marks of `studies.documents` it is
generated. Elsewhere its section says

    Measured 2026-11-22, 3c16b67, two cores of an AMD EPYC.

with the commit of the code, and with the machine where times are meant; or the section, or the page
above its first section, has the comment `<!-- settings -->`: its numbers are chosen, not measured
(constants, thresholds, published values with their source).
"""

from __future__ import annotations

import re
from collections import Counter
from typing import Literal

Origin = Literal["generated", "measured", "setting", "unknown"]

GENERATED = re.compile(r"<!-- numbers:[^>]*?-->\n.*?<!-- end -->", re.S)
CODE = re.compile(r"```.*?```|`[^`\n]*`|\]\([^)]*\)|https?://\S+", re.S)
NUMBER = re.compile(r"(?<![\w.])(?<![a-z]-)\d*\.\d+(?![\w.]*\w\.)")  # not of noise-0.05
MEASURED = re.compile(r"Measured\s\d{4}-\d\d-\d\d,\s[0-9a-f]{7}\b")
SETTINGS = "<!-- settings -->"
_HEADING = re.compile(r"^(?=#+ )", re.M)


def origins(text: str) -> tuple[Counter[Origin], list[int]]:
    """Count the numbers of a page by origin, and list the lines of those of unknown origin.

    A line is that of the heading of the section.
    """
    counts: Counter[Origin] = Counter()
    unknown = []
    line = 1
    # as many lines as before, so that places stay
    without_code = CODE.sub(lambda match: "\n" * match[0].count("\n"), text)
    for section in _HEADING.split(without_code):
        generated = sum(len(NUMBER.findall(table)) for table in GENERATED.findall(section))
        others = len(NUMBER.findall(GENERATED.sub("", section)))
        origin: Origin = "unknown"
        if SETTINGS in section:
            origin = "setting"
        elif MEASURED.search(section):
            origin = "measured"
        elif others:
            unknown.append(line)
        counts["generated"] += generated
        counts[origin] += others
        line += section.count("\n")
    return counts, unknown
