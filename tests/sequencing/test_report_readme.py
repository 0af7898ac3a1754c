"""The Python of README and documentation: it compiles, its names exist; the slow test runs it."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/index.md", "docs/outputs.md")


def snippets(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), flags=re.S)


@pytest.mark.parametrize("page", PAGES)
def test_the_names_of_every_snippet_exist(page):
    assert snippets(page)
    for text in snippets(page):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(node.module)
                for name in node.names:
                    assert getattr(module, name.name) is not None


def test_the_readme_snippet_is_ten_lines():
    (text,) = snippets("README.md")
    assert len([line for line in text.splitlines() if line.strip()]) <= 10


@pytest.mark.slow
def test_the_readme_snippet_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (text,) = snippets("README.md")
    exec(compile(text, "README.md", "exec"), {"__name__": "snippet"})
    assert "cheaper than the sequence of least time" in capsys.readouterr().out
    assert (tmp_path / "runs" / "mine" / "result.json").is_file()


def test_the_pages_link_to_files_that_exist():
    for page in ("README.md", "CONTRIBUTING.md"):
        for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / page).read_text(encoding="utf-8")):
            assert (ROOT / target).is_file(), f"{page}: {target}"
