"""A package counts as there if it can be imported, not if it is merely installed."""

from experiments.importable import is_importable


def test_a_package_whose_system_library_is_missing_is_not_importable(tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text("raise ImportError('libusb-1.0.so.0')")
    (tmp_path / "whole.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    names = ("broken", "whole", "no_such_package")
    assert [is_importable(name) for name in names] == [False, True, False]
