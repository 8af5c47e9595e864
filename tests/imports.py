"""Imports run downwards only (the house of docs/design.md). Run as a script, or by tests/test_imports.py."""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

# from the top of the house to its bottom; modules of one row may import each other
HOUSE = [
    {"gonio.cli"},
    {"gonio.commands"},
    {"gonio.daemon", "gonio.bench"},
    {"gonio.products", "gonio.check"},
    {"gonio.run", "gonio.running"},
    {"gonio.acquire"},
    {"gonio.rigs"},
    {"calibration"},
    {"drivers", "sim"},
    {"gonio.rig"},
    {"gonio.load"},
    {"gonio.render"},
    {"gonio.export"},
    {"gonio.evaluate"},
    {"gonio.progress"},
    {"gonio.store"},
    {"gonio.run_folder"},
    {"gonio.reconstruct"},
    {"gonio.mcmc"},
    {"gonio.flow"},
    {"gonio.brdf"},
    {"gonio.geometry"},
    {"gonio.config"},
]
LEVEL = {name: k for k, row in enumerate(HOUSE) for name in row}
NEVER = {("sim", "drivers"), ("drivers", "sim")}


def room(module: str) -> str | None:
    """The row's entry a module belongs to, None for what is not ours (and for the package `gonio` itself)."""
    parts = module.split(".")
    return next((n for n in (".".join(parts[:2]), parts[0]) if n in LEVEL), None)


def imports(path: Path):
    """(line, module) of every import of a file, those inside functions included."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, a.name) for a in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.lineno, node.module
            yield from ((node.lineno, f"{node.module}.{a.name}") for a in node.names)


def violations(root: Path = ROOT) -> list[str]:
    """One line per import that runs upwards, or between sim and drivers, or of torch outside gonio/flow/train.py."""
    out = []
    for folder in ("gonio", "drivers", "sim", "calibration"):
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


if __name__ == "__main__":
    found = violations()
    print("\n".join(found) or "imports run downwards only")
    sys.exit(bool(found))
