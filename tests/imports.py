"""Imports run downwards only (the house of docs/design.md). Run as a script, or by tests/test_imports.py."""

import ast
import sys
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST_FILES, MOST_LINES = 16, 300
FOLDERS = ("gonio", "drivers", "sim", "calibration")

# from the top of the house to its bottom; modules of one row may import each other. A module belongs to the longest
# name that it begins with
HOUSE = [
    {"gonio.cli"},
    {"gonio.commands"},
    {"gonio.daemon", "gonio.bench", "gonio.api"},
    {"gonio.importing"},
    {"gonio.run"},
    {"gonio.budget"},
    {"gonio.acquire"},
    {"gonio.run.open_rig"},
    {"calibration"},
    {"drivers", "sim"},
    {"gonio.testing"},
    {"gonio.rig"},
    {"gonio.load"},
    {"gonio.render"},
    {"gonio.export"},
    {"gonio.run.record"},
    {"gonio.reconstruct"},
    {"gonio.mcmc"},
    {"gonio.flow"},
    {"gonio.evaluate"},
    {"gonio.brdf"},
    {"gonio.picture"},
    {"gonio.geometry"},
    {"gonio.config"},
    {"gonio.atomic"},
]
LEVEL = {name: k for k, row in enumerate(HOUSE) for name in row}
NEVER = {("sim", "drivers"), ("drivers", "sim")}


def room(module: str) -> str | None:
    """The row's entry a module belongs to, None for what is not ours (and for the package `gonio` itself)."""
    parts = module.split(".")
    return next((n for k in range(len(parts), 0, -1) if (n := ".".join(parts[:k])) in LEVEL), None)


def imports(path: Path):
    """(line, module) of every import of a file, those inside functions included."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, a.name) for a in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.lineno, node.module
            yield from ((node.lineno, f"{node.module}.{a.name}") for a in node.names)


def named(path: Path, known) -> set[str]:
    """The modules of `known` that a file imports; of `from package import module` the module alone."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {n if (n := f"{node.module}.{a.name}") in known else node.module for a in node.names}
    return found & set(known)


def violations(root: Path = ROOT) -> list[str]:
    """One line per import that runs upwards, or between sim and drivers, or of torch outside gonio/flow/train.py."""
    out = []
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*.py")):
            module = ".".join(path.relative_to(root).with_suffix("").parts)
            here = room(module)
            for line, name in imports(path):
                if name.split(".")[0] == "torch" and not module.startswith("gonio.flow.train"):
                    out.append(f"{path.relative_to(root)}:{line}: imports torch; only gonio/flow/train.py may")
                there = room(name)
                if here is None or there is None or here == there:
                    continue
                if LEVEL[there] < LEVEL[here] or (here, there) in NEVER:
                    out.append(f"{path.relative_to(root)}:{line}: {here} imports {there}, which is above it")
    return sorted(set(out))


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Every module of the project, by its dotted name; a package is its `__init__`."""
    found = {}
    for folder in FOLDERS:
        for path in (root / folder).rglob("*.py"):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def circles(root: Path = ROOT) -> list[str]:
    """A line that names modules which import each other, directly or round about, if there are any."""
    known = modules(root)
    sorter = TopologicalSorter[str]()
    for module, path in known.items():
        sorter.add(module, *(named(path, known) - {module}))
    try:
        sorter.prepare()
    except CycleError as e:
        return [" -> ".join(reversed(e.args[1]))]
    return []


def crowded(root: Path = ROOT) -> list[str]:
    """One line per folder with more than MOST_FILES modules, per file of more than MOST_LINES lines."""
    paths = list(modules(root).values())
    folders = Counter(path.parent for path in paths)
    lines = {path: len(path.read_text().splitlines()) for path in paths}
    return sorted(
        [
            f"{folder.relative_to(root)}: {n} files, {MOST_FILES} at most"
            for folder, n in folders.items()
            if n > MOST_FILES
        ]
        + [f"{path.relative_to(root)}: {n} lines, {MOST_LINES} at most" for path, n in lines.items() if n > MOST_LINES]
    )


if __name__ == "__main__":
    found = violations() + [f"circle: {c}" for c in circles()] + crowded()
    print("\n".join(found) or "imports run downwards only, without circles; no room is crowded")
    sys.exit(bool(found))
