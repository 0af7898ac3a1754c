"""Build the documentation: docs/*.md to HTML in docs/_site, and a page with every module.

    python docs/build.py

Exits 1 when a link between pages leads nowhere.
"""

from __future__ import annotations

import ast
import re
import shutil
import sys
from html import escape
from pathlib import Path

import markdown

FOLDER = Path(__file__).resolve().parent
SITE = FOLDER / "_site"
PACKAGES = ("dmoc", "planning", "sequencing")

STYLE = """
body { font: 16px/1.6 system-ui, sans-serif; color: #1d2328; max-width: 860px;
  margin: 0 auto; padding: 0 1.2rem 4rem; }
nav { border-bottom: 1px solid #d9dee3; padding: 1rem 0; margin-bottom: 1.5rem; }
nav a { margin-right: 1.2rem; }
a { color: #0072b2; text-decoration: none; } a:hover { text-decoration: underline; }
pre { background: #f5f6f8; padding: .8rem 1rem; overflow-x: auto; font-size: .85rem; }
code { font-size: .9em; background: #f5f6f8; } pre code { background: none; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
th, td { border-bottom: 1px solid #d9dee3; padding: .3rem .7rem; text-align: left;
  vertical-align: top; }
"""


def modules_page() -> str:
    """Markdown with the first sentence of every module, by package."""
    lines = ["# Modules", "", "Every module with the first line of its documentation."]
    for package in PACKAGES:
        lines += ["", f"## {package}", "", "| module | what it is |", "| --- | --- |"]
        for path in sorted((FOLDER.parent / package).rglob("*.py")):
            text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
            if text:
                name = ".".join(path.relative_to(FOLDER.parent).with_suffix("").parts)
                first = text.splitlines()[0].replace("|", "\\|").replace("`", "")
                lines.append(f"| `{name.removesuffix('.__init__')}` | {first} |")
    return "\n".join(lines) + "\n"


def title_of(text: str, name: str) -> str:
    """The first heading of a page, else its name."""
    heading = re.search(r"^# (.+)$", text, flags=re.M)
    return heading.group(1) if heading else name


def page(text: str, name: str, titles: dict[str, str]) -> str:
    """HTML of one page with the links to all others."""
    links = "".join(
        f'<a href="{other}.html">{escape(title)}</a>' for other, title in titles.items()
    )
    body = markdown.markdown(text, extensions=["tables", "fenced_code", "toc"])
    body = re.sub(r'href="([\w-]+)\.md(#[\w-]+)?"', r'href="\1.html\2"', body)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(titles[name])}</title><style>{STYLE}</style></head>\n"
        f"<body><nav>{links}</nav>\n{body}\n</body></html>\n"
    )


def broken_links(texts: dict[str, str]) -> list[str]:
    """Links to pages or files of this folder that do not exist."""
    found = []
    for name, text in texts.items():
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
            if re.match(r"[a-z]+:", target):
                continue
            stem = target.removesuffix(".md")
            if stem not in texts and not (FOLDER / target).exists():
                found.append(f"{name}.md: {target}")
    return found


def main() -> int:
    """Write docs/_site; 1 if a link is broken."""
    texts = {path.stem: path.read_text(encoding="utf-8") for path in sorted(FOLDER.glob("*.md"))}
    texts = {"index": texts.pop("index"), **texts, "modules": modules_page()}
    titles = {name: title_of(text, name) for name, text in texts.items()}
    shutil.rmtree(SITE, ignore_errors=True)
    SITE.mkdir()
    for name, text in texts.items():
        (SITE / f"{name}.html").write_text(page(text, name, titles), encoding="utf-8")
    broken = broken_links(texts)
    for line in broken:
        sys.stderr.write(f"broken link: {line}\n")
    sys.stdout.write(f"{len(texts)} pages in {SITE.relative_to(FOLDER.parent)}\n")
    return 1 if broken else 0


if __name__ == "__main__":
    raise SystemExit(main())
