"""The parts of the package and what they import, read from the source; `python tests/layout.py` draws them."""

import ast
import graphlib
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "hybridsens"
MODULES = sorted(PACKAGE.rglob("*.py"))


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


NAMES = {module_name(path).removesuffix(".__init__") for path in MODULES}


def imports(path: Path, of: str = "hybridsens") -> set[str]:
    """Modules of a package that a file imports, wherever the import stands: in functions and for types alone too."""
    package = module_name(path).split(".")[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = base + (node.module.split(".") if node.module else [])
            names = {".".join([*origin, alias.name]) for alias in node.names}
            found |= {name if name in NAMES else ".".join(origin) for name in names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name for name in found if name.split(".")[0] == of}


def part_of(name: str) -> str:
    """The folder or file below the package that a module belongs to."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def parts() -> dict[str, set[str]]:
    """Part -> parts that it imports, the facade apart."""
    graph: dict[str, set[str]] = {}
    for path in MODULES:
        part = part_of(module_name(path))
        graph.setdefault(part, set()).update(part_of(name) for name in imports(path))
    return {part: found - {part} for part, found in graph.items() if part != "__init__"}


def floors(graph: dict[str, set[str]]) -> list[list[str]]:
    """Parts that import only from the floors before them, each on the first floor on which it can stand."""
    level: dict[str, int] = {}
    for part in graphlib.TopologicalSorter(graph).static_order():
        level[part] = 1 + max((level[below] for below in graph[part]), default=-1)
    return [sorted(part for part in level if level[part] == k) for k in range(max(level.values()) + 1)]


def needed(part: str, graph: dict[str, set[str]]) -> set[str]:
    """The imports of a part but for those that it has through others."""
    reach = lambda start: set().union(*({below} | reach(below) for below in graph[start]))
    return graph[part] - set().union(*(reach(below) for below in graph[part]))


def drawing() -> str:
    """Floors from the ground up, and behind each part what it stands on."""
    graph = parts()
    width = max(map(len, graph))
    lines = []
    for number, floor in enumerate(floors(graph)):
        for k, part in enumerate(floor):
            below = ", ".join(sorted(needed(part, graph)))
            head = f"{number if k == 0 else '':>2}  {part:<{width}}  "
            lines.append(textwrap.fill(head + (f"<- {below}" if below else ""), 110, subsequent_indent=" " * len(head)))
    return "\n".join(line.rstrip() for line in lines)


if __name__ == "__main__":
    print(drawing())
