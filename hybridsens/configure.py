"""Settings that JAX reads once, when it starts: made by one call, before anything runs. Nothing is set at import."""

import contextlib
import ctypes
import os
from pathlib import Path
from typing import Any

import jax

_BACKEND = "--xla_backend_extra_options="

_SMALL_LOOP = "xla_cpu_small_while_loop_byte_threshold="

_LOOPS = ("-unroll-full-max-count=4", "-forget-scev-loop-unroll=true")
"""LLVM writes out loops of up to 4 turns and no longer ones. A loop over 16 coordinates, of which a kernel holds
hundreds, is slower written out: 16 masses in a chain take 10 % less time so and a quarter less to compile, a pendulum
of 16 links 40 % less of both. And what LLVM knows of loops it forgets at once, not loop by loop: a fifth less to
compile where there are many."""

_PRODUCTS = "--xla_cpu_experimental_ynn_fusion_type="
"""Empty: no product of two matrices is handed to a library, where it would keep the loop around it from becoming one
kernel. With eight contacts that makes a motion twice as fast, its gradient three times."""

_KNOWN = {(0, 10), (0, 11)}
"""Versions of JAX that know these two. The process ends where XLA is given a flag that it does not know."""


_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Numbers of two parameters of the C library's `mallopt`."""

_KEPT = 2**27
"""Bytes of free memory that stay with the process."""

_made: dict[str, Any] = {}
"""The settings made that JAX reads once."""


def configure(
    *,
    x64: bool = True,
    host_devices: int | None = None,
    small_loop_bytes: int = 16_777_216,
    cache: str | Path | bool | None = None,
) -> None:
    """Set JAX up for hybridsens. Call it once, before the first array is made. Without it motions are computed in
    single precision, and several times slower.

    - `x64`: double precision, which the accuracy of this package is stated for.
    - `host_devices`: how many devices a CPU shows as, so that a sweep uses that many cores. Default: leave it.
    - `small_loop_bytes`: a loop that carries less than this is compiled into one kernel on a CPU instead of being
      interpreted operation by operation. It makes motions several times faster, and compiles faster. With hundreds of
      coordinates a loop carries more: 2**31 - 1 makes gradients there up to a sixth faster again, and takes a half
      longer to compile or more (a program that runs thousands of times makes up for it).
    - `cache`: a folder in which JAX keeps compiled programs for the next start of Python; True for one below the
      user's own folder of caches ($XDG_CACHE_HOME, or ~/.cache). Default: leave it. The command line keeps them.

    It also makes a CPU run programs in the calling thread (waking another thread costs more than a short motion), and
    keeps its compiler from writing out loops of more than four turns. On Linux the process keeps up to 128 MB of free
    memory: a motion with a record of megabytes takes up to two fifths less time where these are not fetched anew at
    every call.
    The same call again does nothing, so that a notebook's cell can be run twice; `cache` may be changed at any time.

    Raises: RuntimeError if JAX has already started with other settings, since it reads them only then.
    """
    if cache:
        jax.config.update("jax_compilation_cache_dir", str(_users_cache() if cache is True else cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    wanted: dict[str, Any] = dict(x64=x64, small_loop_bytes=small_loop_bytes)
    wanted |= {} if host_devices is None else dict(host_devices=host_devices)
    if wanted.items() <= _made.items():
        return
    if _has_started():
        raise RuntimeError(
            "JAX has already started, and reads these settings only once. Call hybridsens.configure() before the "
            "first JAX array is made (imports are fine). Without it motions are in single precision, and slower."
        )
    _made.update(wanted)
    _keep_memory()
    given = os.environ.get("XLA_FLAGS", "").split()
    known = jax.__version_info__[:2] in _KNOWN
    flags = [flag for flag in given if not flag.startswith(_BACKEND)]
    flags.append(_backend_options(given, small_loop_bytes, _LOOPS if known else ()))
    if known and not any(flag.startswith(_PRODUCTS) for flag in flags):
        flags.append(_PRODUCTS)
    if host_devices is not None:
        flags = [flag for flag in flags if not flag.startswith("--xla_force_host_platform_device_count")]
        flags.append(f"--xla_force_host_platform_device_count={host_devices}")
    os.environ["XLA_FLAGS"] = " ".join(flags)
    jax.config.update("jax_enable_x64", x64)
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def _backend_options(flags: list[str], small_loop_bytes: int, loops: tuple[str, ...]) -> str:
    """The options of XLA's backend: those given in the environment, and ours, of which the size is set anew."""
    given = [option for flag in flags if flag.startswith(_BACKEND) for option in flag.removeprefix(_BACKEND).split(",")]
    names = {option.split("=")[0] for option in given}
    ours = [option for option in loops if option.split("=")[0] not in names]
    kept = [option for option in given if not option.startswith(_SMALL_LOOP)]
    return _BACKEND + ",".join([*kept, *ours, f"{_SMALL_LOOP}{small_loop_bytes}"])


def _users_cache() -> Path:
    """Where programs of this user are kept."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hybridsens"


def _has_started() -> bool:
    from jax._src import xla_bridge  # JAX has no public question for this

    return xla_bridge.backends_are_initialized()


def _keep_memory() -> None:
    """Free memory stays with the process, where the C library can be told so (not every one can)."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        for parameter in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
            mallopt(parameter, _KEPT)
