"""A system whose fits have closed forms: x falls by `slope` from `top` to 0, and begins anew."""

import jax

from hybridsens import AbstractHybridSystem


class Sawtooth(AbstractHybridSystem):
    """x(t) = top - slope t until t = top / slope, where x jumps to top; its n-th event comes at n top / slope."""

    slope: jax.Array
    top: jax.Array

    def flow(self, t, x, mode):
        return -self.slope

    def guards(self, t, x, mode):
        return x[None]

    def transition(self, event, t, x, mode):
        return self.top, mode

    def initial_state(self):
        return self.top
