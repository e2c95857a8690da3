"""Outcomes of the expectations of model files, as text, JSON and JUnit XML."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from mbstab.errors import visible
from mbstab.records import dataclass
from mbstab.report import width
from mbstab.report.styles import Style, Text, document, joined, styled

if TYPE_CHECKING:
    from mbstab.analysis.compare.expectations import Outcome


@dataclass(frozen=True)
class Tested:
    """The outcomes of one model file.

    Attributes
    ----------
    name : str
    outcomes : sequence of Outcome
    failure : str
        Why the model could not be answered; empty: it could.
    """

    name: str
    outcomes: Sequence[Outcome]
    failure: str = ""

    @property
    def passed(self) -> int:
        """Number of expectations that hold."""
        return sum(x.passed for x in self.outcomes)

    @property
    def failed(self) -> int:
        """Number of expectations that do not hold; a model without an answer counts as one."""
        return len(self.outcomes) - self.passed + bool(self.failure)


PASSED: tuple[str, Style] = "ok  ", "good"
FAILED: tuple[str, Style] = "FAIL", "bad"


def tested_text(models: Sequence[Tested], failures_only: bool) -> Text:
    """Return a paragraph for each expectation, which begins with its place in the file, and how many hold."""
    lines: list[str] = []
    for model in models:
        if model.failure:
            lines.append(joined([styled(*FAILED), visible(model.name, lines=False)], " "))
        for x in model.outcomes:
            if not (x.passed and failures_only):
                mark, place = styled(*(PASSED if x.passed else FAILED)), f" {x.location}: "
                first, *rest = wrap(
                    f"{x.what}: {x.detail}",
                    width=width(),
                    initial_indent=mark + place,
                    subsequent_indent=" " * 5,
                    break_long_words=False,
                    break_on_hyphens=False,
                )
                lines += [joined([mark, first.removeprefix(mark)], ""), *rest]
    lines.append(f"{sum(x.passed for x in models)} passed, {sum(x.failed for x in models)} failed")
    return document(lines)


def tested_data(models: Sequence[Tested]) -> dict[str, Any]:
    """Return the JSON object of ``mbstab test``.

    Keys: ``passed`` and ``failed`` (numbers), ``models`` (``model``, ``failure``: why there is no answer, else null,
    and ``expectations``: ``line``, ``column``, ``what``, ``passed``, ``detail``).
    """
    return {
        "passed": sum(x.passed for x in models),
        "failed": sum(x.failed for x in models),
        "models": [
            {
                "model": model.name,
                "failure": model.failure or None,
                "expectations": [
                    {
                        "line": x.location.line,
                        "column": x.location.column,
                        "what": x.what,
                        "passed": x.passed,
                        "detail": x.detail,
                    }
                    for x in model.outcomes
                ],
            }
            for model in models
        ],
    }


def tested_junit(models: Sequence[Tested]) -> str:
    """Return JUnit XML, which continuous integration reads: a suite for each model, a case for each expectation."""
    root = ElementTree.Element("testsuites", name="mbstab test")
    for model in models:
        name = visible(model.name, lines=False)
        count = len(model.outcomes) + bool(model.failure)
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=name,
            tests=str(count),
            failures=str(len(model.outcomes) - model.passed),
            errors=str(int(bool(model.failure))),
        )
        if model.failure:
            case = ElementTree.SubElement(suite, "testcase", classname=name, name="answer")
            error = ElementTree.SubElement(case, "error", message=visible(model.failure.splitlines()[0]))
            error.text = visible(model.failure)
        for x in model.outcomes:
            title = f"line {x.location.line}: {x.what}"
            case = ElementTree.SubElement(suite, "testcase", classname=name, name=title)
            if not x.passed:
                ElementTree.SubElement(case, "failure", message=x.detail).text = f"{x.location}: {x.detail}"
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
