"""Settings that JAX reads once, when it starts: made by one call, before anything runs. Nothing is set at import."""

import os

import jax

_SMALL_LOOP = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold="


def configure(*, x64: bool = True, host_devices: int | None = None, small_loop_bytes: int = 16_777_216) -> None:
    """Set JAX up for hybridsens. Call it once, before the first array is made; results are right without it.

    - `x64`: double precision, which the accuracy of this package is stated for.
    - `host_devices`: how many devices a CPU shows as, so that a sweep uses that many cores. Default: leave it.
    - `small_loop_bytes`: a loop that carries less than this is compiled into one kernel on a CPU instead of being
      interpreted operation by operation. It makes motions several times faster, and compiles faster.

    It also makes a CPU run programs in the calling thread: waking another thread costs more than a short motion.

    Raises: RuntimeError if JAX has already started, since it reads these settings only then.
    """
    if _has_started():
        raise RuntimeError(
            "JAX has already started, and reads these settings only once. Call hybridsens.configure() before the "
            "first JAX array is made (imports are fine), or leave it out: everything is right without it, only slower."
        )
    flags = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if not flag.startswith(_SMALL_LOOP)]
    flags.append(f"{_SMALL_LOOP}{small_loop_bytes}")
    if host_devices is not None:
        flags = [flag for flag in flags if not flag.startswith("--xla_force_host_platform_device_count")]
        flags.append(f"--xla_force_host_platform_device_count={host_devices}")
    os.environ["XLA_FLAGS"] = " ".join(flags)
    jax.config.update("jax_enable_x64", x64)
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def _has_started() -> bool:
    from jax._src import xla_bridge  # JAX has no public question for this

    return xla_bridge.backends_are_initialized()
