"""The outcome of a gradient check: what is found of each parameter, what is in doubt and why, and how it reads."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from ..export.text import name_and_numbers, preformatted, wrapped
from .check_default import AtDefault
from .check_events import OTHER_EVENTS, EventCheck

UNDECIDED = "not decided"
"""How a verdict begins that no test could make."""
ONE_SIDED = "one-sided"
"""How that of a derivative begins that holds on one side alone."""
KINK = f"{ONE_SIDED}: J has a kink here"
"""How it begins where the same events happen on both sides."""
MOST_ROWS, FIRST_ROWS, FIRST_NAMES = 40, 20, 8
"""Of more parameters than that so many have a row, and of more names so many are told."""
MOST_LETTERS = 10
"""In the name of a contact that stands in a row of 80 columns."""

_ALL_ZERO = (
    "Every derivative is zero: make sure that the cost reads the motion of its scene, and that the events happen whose "
    "rows it reads."
)
_NUMBERED = "0:2 is event 2 of motion 0 of the cost, both counted from 0."


class ParameterCheck(NamedTuple):
    """One entry of the gradient by three methods."""

    parameter: str
    adjoint: float
    forward: float
    differences: float
    """With the sequence of events kept; nan where it changes within the smallest differences tried."""
    uncertainty: float
    """How far the differences of two widths are apart."""
    reference: float
    """By another solver, with the derivative resolved much better; nan where that takes too many steps."""
    verdict: str
    """Empty where all agree; begins with `UNDECIDED` where that cannot be told, with `ONE_SIDED` where it holds on one
    side alone."""


class Cause(NamedTuple):
    """One likely cause of a doubt."""

    kind: str
    """"no derivative", "step control", "motion", "discontinuity", "grazing", "simultaneous impacts",
    "event at a data time", "event at a jump time", "jump time at an end", "changed sequence", "kink", "other events",
    "undecided" or "unexplained"."""
    parameters: tuple[str, ...]
    """In which parameters it is to be looked for."""
    events: tuple[str, ...]
    """And in which events, by their labels in the report."""
    reason: str
    remedy: str


class Doubts(NamedTuple):
    """What is in doubt."""

    parameters: tuple[str, ...]
    events: tuple[EventCheck, ...]

    def cause(self, kind: str, reason: str, remedy: str, events: Sequence[EventCheck] = ()) -> Cause:
        """A cause that may lie behind every parameter, and behind the given ones of the events."""
        return Cause(kind, self.parameters, tuple(entry.label for entry in events), reason, remedy)


class GradientCheck(NamedTuple):
    """Outcome of a check; print it."""

    parameters: tuple[ParameterCheck, ...]
    """What was found of the derivative by each parameter."""
    events: tuple[EventCheck, ...]
    """What was found of each event."""
    causes: tuple[Cause, ...] = ()
    """Likely causes of what is in doubt."""
    at_default: AtDefault | None = None
    """What the gradient is at the default tolerance of a motion; None where the check was not made at a tighter one."""

    @property
    def ok(self) -> bool:
        """Whether every test that could be made was passed, and each parameter could be tested."""
        wrong = [entry for entry in self.events if entry.verdict and entry.verdict != OTHER_EVENTS]
        return not wrong and not any(entry.verdict for entry in self.parameters)

    _repr_html_ = preformatted  # what a notebook shows

    def __str__(self) -> str:
        """One line for each parameter and for each event, and a last line that sums up."""
        width = max(len("dJ/d"), *(len(entry.parameter) for entry in self.parameters)) + 2
        columns = f"{'adjoint':>15}{'forward':>15}{'differences':>15}{'+-':>9}{'reference':>15}"
        lines = [name_and_numbers("dJ/d", columns, width)]
        shown = self._shown()
        lines += [_parameter_line(entry, width) for entry in shown]
        if hidden := [entry for entry in self.parameters if entry not in shown]:
            doubtful = sum(bool(entry.verdict) for entry in hidden)
            lines.append(f"... and {len(hidden)} more, of which {doubtful} are in doubt")
        lines += ["", *_event_lines(self.events)] if self.events else []
        at_default = [] if self.at_default is None else [str(self.at_default)]
        if self.ok:
            all_tested = not any(entry.verdict for entry in self.events)
            told = ["All agree."] if all_tested else ["All that could be tested agree.", *map(_cause_line, self.causes)]
            if not any(entry.adjoint or entry.differences for entry in self.parameters):
                told += [wrapped(_ALL_ZERO, 4)]
            return "\n".join([*lines, "", *told, *at_default])
        wrong = [entry.parameter for entry in self.parameters if entry.verdict]
        events = [entry.label for entry in self.events if entry.verdict]
        doubt = wrapped(f"In doubt: parameters {_listed(wrong) or '-'}; events {_listed(events) or '-'}.", 4)
        causes = [_cause_line(cause) for cause in self.causes]
        numbered = [_NUMBERED] if re.search(r"\d:\d", "".join(causes)) else []
        return "\n".join([*lines, "", doubt, *causes, *numbered, *at_default])

    def _shown(self) -> list[ParameterCheck]:
        """The parameters that have a row: of many those in doubt, then the first ones whose derivative is not 0."""
        if len(self.parameters) <= MOST_ROWS:
            return list(self.parameters)
        says_little = lambda entry: (not entry.verdict, entry.adjoint == 0 and entry.differences == 0)
        return sorted(self.parameters, key=says_little)[:FIRST_ROWS]


def _parameter_line(entry: ParameterCheck, width: int) -> str:
    numbers = "".join(f"{slope:>15.8g}" for slope in (entry.adjoint, entry.forward, entry.differences))
    numbers += f"{entry.uncertainty:>9.1e}{entry.reference:>15.8g}"
    return name_and_numbers(entry.parameter, numbers, width, entry.verdict)


def _event_lines(events: tuple[EventCheck, ...]):
    """A header and a row for each event, with the names of contacts where these leave room for all columns."""
    names = [entry.contact_name or str(entry.contact) for entry in events]
    if max(map(len, names)) > MOST_LETTERS:
        names = [str(entry.contact) for entry in events]
    wide = 1 + max(map(len, ["contact", *names]))
    yield f"{'event':>7}{'time':>13}{'kind':>9}{'contact':>{wide}}{'closing speed':>14}" + (
        f"{'determinant':>13}{'expected':>13}"
    )
    yield from (_event_line(entry, f"{name:>{wide}}") for entry, name in zip(events, names, strict=True))


def _event_line(entry: EventCheck, contact: str) -> str:
    determinant = 0.0 if abs(entry.determinant) < 1e-99 else entry.determinant  # a longer exponent has no room
    numbers = (
        f"{entry.time:>13.6f}{entry.kind.name.lower():>9}{contact}"
        f"{entry.closing_speed:>14.4g}{determinant:>13.6g}{entry.expected:>13.6g}"
    )
    return name_and_numbers(f"{entry.label:>7}", numbers, 7, entry.verdict)


def _listed(names: Sequence[str]) -> str:
    """The names, of many the first ones and how many there are."""
    if len(names) <= MOST_ROWS:
        return ", ".join(names)
    return f"{', '.join(names[:FIRST_NAMES])}, ... ({len(names)} in all)"


def _cause_line(cause: Cause) -> str:
    where = (_listed(cause.parameters), f"events {_listed(cause.events)}" if cause.events else "")
    text = f"Likely cause for {'; '.join(filter(None, where))}: {cause.reason}. What to do: {cause.remedy}."
    return wrapped(text, 4)
