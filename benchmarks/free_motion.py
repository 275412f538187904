"""What does a scene without contacts pay for the machinery of events? It should cost one plain `diffeqsolve`.

    python -m benchmarks.free_motion
"""

import diffrax

import hybridsens as hs

from .gradient_cost import timed
from .machine import describe


def main() -> None:
    """Print both times and their ratio, measured in turn."""
    hs.configure()
    import jax
    import jax.numpy as jnp

    class Oscillator(hs.AbstractScene):
        stiffness: jax.Array

        def mass_matrix(self, q):
            return jnp.eye(1)

        def force(self, t, q, v):
            return -self.stiffness * q

        def gap(self, t, q):
            return jnp.zeros(0)

        def restitution(self):
            return jnp.zeros(0)

    start, end = hs.State([1.0], [0.0]), 30.0
    control = diffrax.PIDController(rtol=1e-8, atol=1e-8)
    flow = diffrax.ODETerm(lambda t, y, k: jnp.stack([y[1], -k * y[0]]))

    @jax.jit
    def ours(k):
        return hs.simulate(Oscillator(k), start, t1=end, throw=False).final.q[0]

    @jax.jit
    def plain(k):
        y0 = jnp.array([1.0, 0.0])
        solution = diffrax.diffeqsolve(
            flow, diffrax.Tsit5(), 0.0, end, None, y0, args=k, stepsize_controller=control, throw=False
        )
        return solution.ys[0, 0]

    print(describe())
    k = jnp.array(2.0)
    for _ in range(3):
        a, b = timed(ours, k)[0], timed(plain, k)[0]
        print(f"hybridsens {a * 1e6:.1f} us, plain diffeqsolve {b * 1e6:.1f} us, ratio {a / b:.2f}")


if __name__ == "__main__":
    main()
