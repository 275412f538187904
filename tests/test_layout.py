"""The layout is what the README says: one way of imports, small files."""

import graphlib

import pytest

from tests.layout import MODULES, PACKAGE, ROOT, drawing, imports, module_name, part_of

TESTS = ROOT / "tests"
METHOD = {"observables", "forward", "adjoint", "reported", "passes", "differentiable"}
FRONT = {
    "delays", "simulate", "solve", "solution", "system", "system_checks", "flattened", "outcome", "settings", "watch",
    "discontinuities", "located", "model", "out_of_steps", "border", "until",
}  # fmt: skip
BASE = {"validation", "numerics", "status"}
TOOLS = {"configure", "scenes", "systems", "planar", "plot", "export", "parameters", "waiting"}
CORE = BASE | METHOD | FRONT | TOOLS | {"xla", "flat_system", "interval", "search", "mechanics"}
MAY_IMPORT = {
    "status": set(),
    "numerics": set(),
    "validation": set(),
    "configure": set(),
    "waiting": set(),
    "xla": {"flat_system", "numerics"},
    "interval": set(),
    "flat_system": {"observables", "status"},
    "search": {"flat_system", "interval", "numerics", "validation", "xla"},
    "observables": set(),
    "forward": {"flat_system", "numerics", "observables", "status", "xla"},
    "adjoint": {"flat_system", "forward", "xla", "numerics", "observables", "status", "validation"},
    "reported": {"forward", "flat_system", "observables", "status"},
    "passes": {"flat_system", "forward", "adjoint", "numerics", "observables", "reported", "status"},
    "differentiable": {"passes", "reported", "observables", "adjoint", "forward", "validation", "xla"},
    "export": {"status", "delays"},
    "mechanics": {"flat_system", "model", "interval", "search", "outcome", "export", "watch"}
    | {"discontinuities", "located", "observables", "until"} | BASE,
    "watch": {"numerics"},
    "discontinuities": {"interval", "system", "validation"},
    "saved": {"export", "mechanics", "outcome", "solution", "status"},
    "model": {"export", "validation"},
    "system": {"model"},
    "system_checks": {"system"} | BASE,
    "until": {"validation"},
    "located": {"interval", "system_checks", "xla"} | BASE,
    "delays": set(),
    "flattened": {"delays", "watch", "located", "system", "system_checks", "flat_system", "interval", "search"}
    | {"observables", "solution", "system_decision", "until"} | BASE,
    "solution": {"outcome", "status", "export", "numerics"},
    "system_decision": {"delays", "flat_system", "status", "watch"},
    "settings": {"forward", "adjoint"} | BASE,
    "outcome": {"status", "numerics"},
    "out_of_steps": {"outcome"},
    "border": {"adjoint", "outcome", "out_of_steps", "validation"},
    "solve": {"export", "waiting"} | FRONT - {"simulate"} | METHOD | BASE,
    "simulate": {"mechanics", "waiting"} | FRONT - {"solve", "solution", "system"} | METHOD | BASE,
    "scenes": {"mechanics", "model", "planar"},
    "systems": {"model", "system"},
    "planar": set(),
    "plot": {"mechanics", "numerics", "export", "outcome", "solution", "delays", "validation", "waiting"},
    "parameters": {"validation"},
    "comparison": CORE,
    "estimation": CORE,
    "sweeps": CORE,
    "cli": CORE | {"comparison", "estimation", "sweeps"},
    "__main__": {"cli"},
    "__init__": CORE | {"comparison", "estimation", "sweeps", "saved"},
}
"""Part of the package -> parts that it may import, itself apart."""

@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_a_file_imports_only_from_floors_above_it(path):
    """Physics and method meet in one small interface, and neither knows what is studied with them."""
    part = part_of(module_name(path))
    forbidden = {name for name in imports(path) if part_of(name) not in MAY_IMPORT[part] | {part}}
    assert not forbidden


def test_imports_form_no_circle():
    """A reader can take the files in an order in which each one needs only those before it: nothing is imported
    later, or for its type alone, to get round that."""
    packages = {module_name(path.parent): module_name(path) for path in MODULES if path.name == "__init__.py"}
    behind = lambda path: {packages.get(name, name) for name in imports(path)} - {module_name(path)}
    graph = {module_name(path): behind(path) for path in MODULES}
    assert len(list(graphlib.TopologicalSorter(graph).static_order())) >= len(MODULES)


def test_the_contributors_page_draws_the_layout_as_it_is():
    """`python tests/layout.py` draws it anew."""
    assert f"```text\n{drawing()}\n```" in (ROOT / "CONTRIBUTING.md").read_text()


def test_files_are_small_and_have_a_subject():
    """No file is too long to be read in one go, and none is a drawer for what has no place."""
    files = [path for folder in ("hybridsens", "tests", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    assert files
    assert [path for path in files if len(path.read_text().splitlines()) > 250] == []
    assert [path for path in files if path.stem in {"utils", "helpers", "misc", "common"}] == []


def test_every_test_and_every_benchmark_is_in_its_index():
    """A page leads from a claim to its test, another from a question to its benchmark."""
    told = (TESTS / "README.md").read_text()
    names = [path.relative_to(TESTS).with_suffix("").as_posix() for path in TESTS.rglob("test_*.py")]
    assert names and [name for name in names if f"`{name}`" not in told] == []
    told = (ROOT / "benchmarks" / "README.md").read_text()
    files = [path for path in (ROOT / "benchmarks").rglob("*.py") if path.parent.name != "peers"]
    assert [path.stem for path in files if path.stem not in told and not path.stem.startswith("_")] == []


def test_tests_mirror_the_package():
    """Who knows where something is knows where its tests are; and tests stand on their own."""
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir()} | {"accuracy", "docs", "problems"}
    assert {path.parent.name for path in TESTS.rglob("*.py") if path.parent != TESTS} <= folders
    origins = {path: imports(path, "benchmarks") for path in TESTS.rglob("*.py")}
    assert origins and {path for path, names in origins.items() if names} == set()
