"""What mkdocs does to every page: equations become MathML and roles of docstrings plain code, with no network."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
_ROLE = re.compile(r":(?:py:)?(?:class|func|meth|mod|data|attr|obj|exc):<code>~?(.*?)</code>")


def on_page_content(text: str, **_: Any) -> str:
    """Return a page's HTML with its equations as MathML, which browsers draw themselves, and without role names."""
    return _ROLE.sub(r"<code>\1</code>", _EQUATION.sub(_mathml, text))


def _mathml(match: re.Match[str]) -> str:
    display = "block" if match[2] == "[" else "inline"
    return convert(html.unescape(match[3]).strip(), display=display)
