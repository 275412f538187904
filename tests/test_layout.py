"""The layout is what the README says: one way of imports, small files."""

import ast
import graphlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "hybridsens"
METHOD = {"forward", "adjoint", "reported", "passes", "differentiable"}
FRONT = {"delays", "simulate", "solve", "solution", "system", "system_checks", "flattened", "outcome", "settings"}
BASE = {"validation", "numerics", "status"}
TOOLS = {"configure", "scenes", "systems", "planar", "plot", "export", "parameters", "waiting"}
CORE = BASE | METHOD | FRONT | TOOLS | {"xla", "flat_system", "interval", "search", "mechanics"}
MAY_IMPORT = {
    "status": set(),
    "numerics": set(),
    "validation": set(),
    "configure": set(),
    "waiting": set(),
    "xla": {"flat_system"},
    "interval": set(),
    "flat_system": {"status"},
    "search": {"flat_system", "interval", "numerics"},
    "forward": {"flat_system", "numerics", "status"},
    "adjoint": {"flat_system", "forward", "xla", "numerics"},
    "reported": {"forward", "flat_system", "status"},
    "passes": {"flat_system", "forward", "adjoint", "reported", "status"},
    "differentiable": {"passes", "reported", "adjoint", "validation", "xla"},
    "export": {"status"},
    "mechanics": {"flat_system", "interval", "search", "outcome", "export"} | BASE,
    "saved": {"export", "mechanics", "outcome", "solution", "status"},
    "system": set(),
    "system_checks": {"system"} | BASE,
    "delays": set(),
    "flattened": {"delays", "status", "system", "system_checks", "flat_system", "numerics", "interval", "search"},
    "solution": {"outcome", "status", "export", "numerics"},
    "settings": {"forward", "adjoint"} | BASE,
    "outcome": {"status"},
    "solve": FRONT - {"simulate"} | METHOD | BASE,
    "simulate": {"mechanics", "waiting"} | FRONT - {"solve", "solution", "system"} | METHOD | BASE,
    "scenes": {"mechanics"},
    "systems": {"system"},
    "planar": set(),
    "plot": {"mechanics", "export", "solution"},
    "parameters": {"validation"},
    "comparison": CORE,
    "estimation": CORE,
    "sweeps": CORE,
    "cli": CORE | {"comparison", "estimation", "sweeps"},
    "__init__": CORE | {"comparison", "estimation", "sweeps", "saved"},
}
"""Part of the package -> parts that it may import, itself apart."""

MODULES = sorted(PACKAGE.rglob("*.py"))


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def _imports(path: Path) -> set[str]:
    """Modules of the package that a file imports, wherever the import stands, but for those of types alone."""
    package = _name(path).split(".")[:-1]
    found = set()
    for node in ast.walk(_WithoutTypeChecking().visit(ast.parse(path.read_text()))):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = base + (node.module.split(".") if node.module else [])
            if not node.module:
                found |= {".".join([*origin, alias.name]) for alias in node.names}
            else:
                found.add(".".join(origin))
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name for name in found if name.split(".")[0] == "hybridsens"}


class _WithoutTypeChecking(ast.NodeTransformer):
    def visit_If(self, node):
        typing_only = isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        return None if typing_only else self.generic_visit(node)


def _part(name: str) -> str:
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


@pytest.mark.parametrize("path", MODULES, ids=_name)
def test_a_file_imports_only_from_floors_above_it(path):
    """Physics and method meet in one small interface, and neither knows what is studied with them."""
    part = _part(_name(path))
    forbidden = {name for name in _imports(path) if _part(name) not in MAY_IMPORT[part] | {part}}
    assert not forbidden


def test_imports_form_no_circle():
    """A reader can take the files in an order in which each one needs only those before it."""
    packages = {_name(path.parent): _name(path) for path in MODULES if path.name == "__init__.py"}
    graph = {_name(path): {packages.get(name, name) for name in _imports(path)} - {_name(path)} for path in MODULES}
    assert len(list(graphlib.TopologicalSorter(graph).static_order())) >= len(MODULES)


def test_files_are_small_and_have_a_subject():
    """No file is too long to be read in one go, and none is a drawer for what has no place."""
    files = [path for folder in ("hybridsens", "tests", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    assert files
    assert [path for path in files if len(path.read_text().splitlines()) > 250] == []
    assert [path for path in files if path.stem in {"utils", "helpers", "misc", "common"}] == []


def test_every_test_and_every_benchmark_is_in_its_index():
    """A page leads from a claim to its test, another from a question to its benchmark."""
    told = (ROOT / "tests" / "README.md").read_text()
    assert [path.stem for path in (ROOT / "tests").glob("test_*.py") if f"`{path.stem}`" not in told] == []
    told = (ROOT / "benchmarks" / "README.md").read_text()
    files = [path for path in (ROOT / "benchmarks").rglob("*.py") if path.parent.name != "peers"]
    assert [path.stem for path in files if path.stem not in told and not path.stem.startswith("_")] == []
