"""The documentation's equations and roles, as mkdocs writes them."""

import importlib.util
from pathlib import Path

from tests.optional import optional_module

optional_module("latex2mathml", "pip install -e '.[docs]'")
FOLDER = Path(__file__).resolve().parents[1]
PAGE = (
    r'<span class="arithmatex">\(a &lt; b\)</span> <div class="arithmatex">\[ x^2 \]</div> '
    ":func:<code>~match</code>"
)


def test_equations_become_mathml_and_roles_plain_code():
    spec = importlib.util.spec_from_file_location("hooks", FOLDER / "docs" / "hooks.py")
    assert spec is not None
    assert spec.loader is not None
    hooks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hooks)
    found = hooks.on_page_content(PAGE)
    assert found.count("<math") == 2
    assert 'display="block"' in found
    assert found.endswith(" <code>match</code>")
    assert "arithmatex" not in found
