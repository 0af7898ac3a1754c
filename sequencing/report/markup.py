"""The little Markdown that our own tables use, as HTML."""

from __future__ import annotations

import re
from html import escape


def markdown_html(text: str) -> str:
    """HTML of headings, paragraphs, pipe tables, dash lists and bold text; all else is escaped.

    A backslash takes its meaning from the sign behind it.

    Blocks are separated by empty lines, as `tables_markdown` writes them.
    """
    return "\n".join(_block(block.strip("\n")) for block in re.split(r"\n\s*\n", text.strip()))


def _block(block: str) -> str:
    lines = block.splitlines()
    if heading := re.match(r"(#{1,4}) (.+)$", block):
        level = len(heading.group(1))
        return f"<h{level}>{_inline(heading.group(2))}</h{level}>"
    if len(lines) >= 2 and all(line.startswith("|") for line in lines):
        return _table(lines)
    if all(line.startswith("- ") for line in lines):
        return "<ul>" + "".join(f"<li>{_inline(line[2:])}</li>" for line in lines) + "</ul>"
    return f"<p>{_inline(' '.join(lines))}</p>"


def _table(lines: list[str]) -> str:
    head, _, *body = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    rows = ["<tr>" + "".join(f"<th>{_inline(cell)}</th>" for cell in head) + "</tr>"]
    rows += [
        "<tr>" + "".join(f"<td>{_inline(cell)}</td>" for cell in row) + "</tr>" for row in body
    ]
    return "<table>" + "\n".join(rows) + "</table>"


def _inline(text: str) -> str:
    bold = re.sub(r"(?<!\\)\*\*(.+?)(?<!\\)\*\*", r"<strong>\1</strong>", escape(text, quote=False))
    return re.sub(r"\\(&\w+;|[^\w\s])", r"\1", bold)
