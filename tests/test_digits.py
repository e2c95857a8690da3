"""The table of digits of the manual: each cell against what is computed, with the cases of `test_extremes`."""

import re
from pathlib import Path

import numpy as np
import pytest
import test_extremes as extremes

from mbstab.errors import MbstabError

PAGE = (Path(extremes.mbstab.__file__).parent / "manual" / "digits.md").read_text(encoding="utf-8")
TABLE = PAGE.partition("## Digits kept")[2].partition("\n## ")[0]
HEAD, *ROWS = [
    [x.strip().replace("`", "") for x in line.split("|")[1:-1]] for line in re.findall(r"^\| .*", TABLE, re.M)
]
CASES = {
    "10 links, masses growing downwards, x10 each": "10 links, masses growing downwards (0)",
    "bricard.yaml": "bricard",
    "plumb line of 200": "plumb line of 50",
}
CELLS = [
    (case, method, said)
    for case, *cells in ROWS
    if not case.startswith("---")
    for method, said in zip(HEAD[1:], cells, strict=True)
    if said != "not tried"
]
REFUSALS = {"rank cannot be decided": "rank of the constraints cannot be decided"}
WARNINGS = {
    "says so": "is known to",
    "warned: hinge taken as redundant": "redundant constraint",
    "warned: angles counted from another orientation": "count from the orientation",
}


def test_the_table_is_found():
    assert HEAD[1:] == ["nullspace", "index3", "paper"]
    assert len(CELLS) > 60


@pytest.mark.parametrize(("case", "method", "said"), CELLS, ids=[f"{case}, {method}" for case, method, _ in CELLS])
def test_a_cell_is_what_is_computed(case, method, said):
    """Digits as far as rounding lets another machine have them: no more than there are, no less than are proven."""
    name = CASES.get(case, case)
    result = extremes.answer(name, method)
    if said.startswith("refused: "):
        assert isinstance(result, MbstabError)
        assert REFUSALS[said.removeprefix("refused: ")] in str(result)
        return
    assert not isinstance(result, MbstabError), result
    if found := re.fullmatch(r"undecided: (\d+) of (\d+) eigenvalues found", said):
        assert int(found[2]) == result.counts.expected != result.counts.found
        assert result.verdict == "undecided"
        return
    digits, _, notes = said.partition(" (")
    notes = [] if not notes else notes.removesuffix(")").split(", ")
    assert (result.verdict == "undecided") == ("undecided" in notes)
    warned = any("is known to" in text for text in result.warnings)
    assert warned == ("says so" in notes) or method == "paper"
    for note in set(notes) - {"undecided", "says so"}:
        assert any(WARNINGS[note] in text for text in result.warnings)
    errors, bounds, sizes = extremes.compared(result, extremes.truth(name))
    if method == "paper":  # it keeps what one machine's rounding happens to leave
        assert np.all(errors <= bounds)
        return
    most, least = (-np.log10(np.max(x / sizes) + 1e-16) for x in (errors, bounds))
    assert least - 1.0 <= int(digits) <= max(most, 0.0) + 1.5
