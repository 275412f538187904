"""What every ready-made system has beside its dynamics: where it starts, how long it runs, what it costs."""

import abc
from typing import Any, ClassVar

from jaxtyping import Array, Float

from ..model import parameter as parameter
from ..system import AbstractHybridSystem, Mode


class ShippedSystem(AbstractHybridSystem):
    """A system that can be run as it is:

    `solve(system, system.initial_state(), system.initial_mode(), t1=system.t1, running_cost=type(system).running_cost)`
    """

    t1: ClassVar[float]
    """End of the horizon that shows the system well, in its unit of time; it starts at 0."""

    @abc.abstractmethod
    def initial_state(self) -> Any:
        """Where the motion starts, computed from the system's parameters."""

    def initial_mode(self) -> Mode:
        """The mode in which it starts; None where there is only one."""
        return None

    @abc.abstractmethod
    def running_cost(self, t: Float[Array, ""], x: Any, mode: Any) -> Float[Array, ""]:
        """Integrand of the system's functional J."""
