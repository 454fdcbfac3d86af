"""Plain pages: texts of users stay texts, and nothing is loaded."""

from data_tools.html_pages import html_figure, html_table, write_html_page


def test_texts_are_escaped_and_a_page_loads_nothing(tmp_path):
    evil = "<script>alert('x')</script>"
    body = html_table(evil, ["a", evil], [["1", evil]]) + html_figure(b"png", evil)
    page = write_html_page(tmp_path / "page.html", evil, body).read_text()
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 7
    assert "default-src 'none'; script-src 'none'; style-src 'unsafe-inline'; img-src data:" in page
    assert "http" not in page.replace("http-equiv", "")
    assert "prefers-color-scheme: dark" in page
    assert "max-width: 40rem" in page
