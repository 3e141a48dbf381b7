"""What a reader made of rendered signs: results in, tables of outcomes and of its confidence's reliability out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

from common.room_number import key_of
from offboard.evaluate.figures import letters_of
from offboard.evaluate.signs.layouts import Layout
from offboard.evaluate.signs.scenes import Case, Kind

BINS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999)  # of confidence, from


class Outcome(Enum):
    """Of a case with a number; where there is none, NONE is right and FALSE is not."""

    EXACT = "exact"
    WRONG = "wrong"
    DOUBTFUL = "doubtful"
    NONE = "none"
    FALSE = "false"


@dataclass(frozen=True, slots=True)
class Answer:
    """A number that a reader found: as shown, how sure, and whether it counts."""

    shown: str
    confidence: float
    counts: bool


@dataclass(frozen=True, slots=True)
class Result:
    """A case without its picture, and what was made of it."""

    kind: Kind
    index: int
    form: str
    layout: Layout | None
    number: str
    font: str
    capitals_px: float
    answers: tuple[Answer, ...]

    @property
    def outcome(self) -> Outcome:
        counted = [answer for answer in self.answers if answer.counts]
        if not self.number:
            return Outcome.FALSE if counted else Outcome.NONE
        if counted:
            return Outcome.EXACT if all(self.is_right(answer) for answer in counted) else Outcome.WRONG
        return Outcome.DOUBTFUL if self.answers else Outcome.NONE

    def is_right(self, answer: Answer) -> bool:
        """Separators kept; but a number on two lines shows none at the break."""
        if self.layout is Layout.TWO_LINES:
            return letters_of(answer.shown) == letters_of(self.number)
        return key_of(answer.shown) == key_of(self.number)


def result(case: Case, answers: Sequence[Answer]) -> Result:
    return Result(
        case.kind, case.index, case.form.name, case.layout, case.number, case.font, case.capitals_px, tuple(answers)
    )


def shares(results: Iterable[Result], kind: Kind) -> dict[Outcome, float]:
    """Of all cases of a kind."""
    counts = Counter(r.outcome for r in results if r.kind is kind)
    return {outcome: counts[outcome] / max(counts.total(), 1) for outcome in Outcome}


def outcome_table(results: Sequence[Result]) -> list[str]:
    """Lines for people: outcomes by kind, by layout, and what was worst by form and font."""
    lines = [f"{'':26}" + "".join(f"{outcome.value:>10}" for outcome in Outcome) + "     cases"]
    for kind in Kind:
        lines.append(_line(kind.value, [r for r in results if r.kind is kind]))
    for layout in Layout:
        lines.append(_line(f"  {layout.value}", [r for r in results if r.kind is Kind.PLATE and r.layout is layout]))
    for what in ("form", "font"):
        names = sorted({getattr(r, what) for r in results if r.kind is Kind.PLATE})
        of = {name: [r for r in results if r.kind is Kind.PLATE and getattr(r, what) == name] for name in names}
        worst = sorted(names, key=lambda name: shares(of[name], Kind.PLATE)[Outcome.EXACT])[:3]
        lines += [_line(f"  worst {what}: {name}", of[name]) for name in worst]
    return lines


def _line(name: str, results: Sequence[Result]) -> str:
    counts = Counter(r.outcome for r in results)
    percent = "".join(f"{100 * counts[outcome] / max(len(results), 1):9.1f}%" for outcome in Outcome)
    return f"{name[:26]:26}{percent}{len(results):10}"


def reliability_table(results: Sequence[Result]) -> list[str]:
    """Lines for people: how often a number is exact by the reader's confidence, if it counts and if it does not."""
    lines = ["confidence from   counted   exact   doubtful   exact"]
    for low, high in zip(BINS, (*BINS[1:], 1.01), strict=True):
        cells = []
        for counts in (True, False):
            within = [
                bool(r.number) and r.is_right(answer)
                for r in results
                for answer in r.answers
                if answer.counts is counts and low <= answer.confidence < high
            ]
            share = f"{100 * sum(within) / len(within):.1f}%" if within else "-"
            cells.append(f"{len(within):7} {share:>7}")
        lines.append(f"{low:15.3f}   {cells[0]}    {cells[1]}")
    return lines
