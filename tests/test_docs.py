"""The docs as a site, warnings as errors; and recipes that run as they stand."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
SITE = ROOT / ".ci" / "mkdocs.yml"


def pages(nav) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    return [page for part in (nav.values() if isinstance(nav, dict) else nav) for page in pages(part)]


def test_every_page_is_in_the_menu_once():
    listed = pages(yaml.safe_load(SITE.read_text())["nav"])
    assert sorted(listed) == sorted(str(p.relative_to(DOCS)) for p in DOCS.rglob("*.md"))


def test_every_picture_is_shown_somewhere():
    text = "".join(p.read_text() for p in [*DOCS.glob("*.md"), ROOT / "README.md"])
    assert [p.name for p in (DOCS / "images").iterdir() if f"images/{p.name}" not in text] == []


def test_every_public_name_is_in_the_api_page():
    import gonio

    text = (DOCS / "api.md").read_text()
    missing = [name for name in gonio.__all__ if not re.search(rf"^::: gonio\..*{name}$", text, re.M)]
    assert missing == []


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs", reason="in the docs extra")
    pytest.importorskip("material", reason="in the docs extra")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-f", SITE, "-d", tmp_path / "site"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    api = (tmp_path / "site" / "api.html").read_text()
    assert "Measure a material and store every reading" in api and "gonio.api.run.Run.to_xarray" in api
    index = json.loads((tmp_path / "site" / "search" / "search_index.json").read_text())
    assert len({d["location"].split("#")[0] for d in index["docs"]}) == len(list(DOCS.rglob("*.md")))
    assert not (DOCS / "site").exists()


@pytest.mark.slow
def test_every_recipe_runs(tmp_path):
    blocks = re.findall(r"^```sh\n(.*?)^```", (DOCS / "cookbook.md").read_text(), re.M | re.S)
    commands = [line for block in blocks for line in block.splitlines() if line.strip()]
    assert len(commands) > 10 and all(c.startswith("gonio ") for c in commands)
    for command in commands:
        words = shlex.split(command)[1:]
        done = subprocess.run([sys.executable, "-m", "gonio.cli", *words], capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0, f"{command}\n{done.stderr}"
