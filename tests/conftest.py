"""What every test starts from: shapes and types checked at run time, double precision, a cache of programs."""

import gc
import os
from pathlib import Path

import jax
import jaxtyping
import pytest

HERE = Path(__file__).parent
WALKS = ("xla/rewriting", "xla/reductions", "xla/scatters")
"""Modules that are asked once for each equation of each trace: of ten checked calls nine were theirs."""


def _checked_modules() -> list[str]:
    """Names of the package's modules but for the walks over traces."""
    root = HERE.parent / "hybridsens"
    files = (path for path in root.rglob("*.py") if path.stem != "__init__")
    names = {path.relative_to(root).with_suffix("").as_posix() for path in files} - set(WALKS)
    return ["hybridsens." + name.replace("/", ".") for name in sorted(names)]


# The annotations of every function are checked at each call. The hook must be there before the package is imported.
jaxtyping.install_import_hook(_checked_modules(), "beartype.beartype")

import hybridsens  # noqa: E402

QUICK = (
    "--xla_cpu_use_fusion_emitters=false --xla_disable_hlo_passes=while-loop-invariant-code-motion "
    "--xla_backend_optimization_level=0"
)
"""Programs that run once are compiled in XLA's older way and not optimised: a quarter less time for all tests. They run
slower so, large batches most of all, for which users keep XLA's own settings."""

# A process ends where XLA does not know a flag.
if jax.__version_info__[:2] == (0, 10):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {QUICK}"
jax.config.update("jax_traceback_in_locations_limit", 0)  # where an operation was written is not looked for
hybridsens.configure()

CORE = (
    "mechanics/test_complementarity", "test_facade", "test_front_door", "interval/test_interval", "adjoint/test_jump",
    "test_layout", "accuracy/test_references",
)  # fmt: skip
"""Files of the first look: laws of an instant, jumps, digits of the references, the front door, the layout."""


def pytest_collection_modifyitems(items):
    for item in items:
        if item.path.relative_to(HERE).with_suffix("").as_posix() in CORE:
            item.add_marker("core")


# Test time is compile time: programs that were compiled once are kept beside the checkout.
jax.config.update("jax_compilation_cache_dir", str(HERE.parent / ".jax_cache"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


@pytest.fixture(autouse=True, scope="module")
def what_is_kept_is_not_looked_through():
    """Programs of the tests before are kept, by the million objects: to look through these again and again for garbage
    took a fifth of all time."""
    yield
    gc.collect()
    gc.freeze()


@pytest.fixture
def unchecked():
    """Without the checks of types that the tests of this package add, as for a user."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
