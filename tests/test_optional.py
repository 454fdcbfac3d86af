"""A package or program that is missing or broken skips a test with what to install; any other fault fails it."""

import sys

import pytest

from tests.optional import optional_module, optional_program

BROKEN = "libusb-1.0.so.0: cannot open shared object file: No such file or directory"


def skip_reason(function, *words, **options):
    with pytest.raises(pytest.skip.Exception) as raised:
        function(*words, **options)
    return str(raised.value)


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Write a module of this code that can be imported."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(code):
        (tmp_path / "stand_in.py").write_text(code)
        monkeypatch.delitem(sys.modules, "stand_in", raising=False)
        return "stand_in"

    return write


def test_what_is_there_is_returned(module):
    assert optional_module(module("value = 5")).value == 5
    assert optional_program("no-such-program", "python3", "python", install="it").startswith("/")


@pytest.mark.parametrize("kind", ["ImportError", "OSError"])
def test_a_library_of_the_system_that_is_missing_skips_and_is_named(module, kind):
    name = module(f"raise {kind}({BROKEN!r})")
    reason = skip_reason(optional_module, name, "apt-get install libusb-1.0-0")
    assert BROKEN in reason
    assert reason.endswith("install it with: apt-get install libusb-1.0-0")


def test_what_is_missing_skips_with_what_to_install():
    assert "No module named 'no_such_module'" in skip_reason(optional_module, "no_such_module")
    assert ".[test]" in skip_reason(optional_module, "no_such_module")
    reason = skip_reason(optional_program, "no-such-program", install="apt-get install it")
    assert reason == "no-such-program is not installed; install it with: apt-get install it"


def test_any_other_fault_of_a_module_fails(module):
    with pytest.raises(AttributeError):
        optional_module(module("import sys; sys.no_such_name"))
    with pytest.raises(SyntaxError):
        optional_module(module("1 +"))
