"""What a gradient check finds of each parameter, what is in doubt, and a likely cause."""

from collections.abc import Sequence
from typing import NamedTuple

from .check_events import EventCheck

UNDECIDED = "not decided"
"""How a verdict begins that no test could make."""

ONE_SIDED = "one-sided"
"""How that of a derivative begins that holds on one side alone."""

KINK = f"{ONE_SIDED}: J has a kink here"
"""How it begins where the same events happen on both sides."""


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
