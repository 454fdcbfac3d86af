"""Packages and programs that a test asks for and a machine may lack: the test skips, and says what to install."""

import shutil
from importlib import import_module

import pytest

#: What installs the packages that tests ask for.
TEST_EXTRA = "pip install -e '.[test]'"
#: What installs the tools that the experiments compare with, and the libraries of the system that Open3D loads.
SYSTEM = "apt-get install libusb-1.0-0 libegl1 libgl1 libx11-6 libgomp1"
OPEN3D_EXTRA = f"pip install -e '.[open3d]' (Debian also: {SYSTEM})"
PEERS_EXTRA = f"pip install -e '.[peers]' (Debian also: {SYSTEM})"


def optional_module(name, install=TEST_EXTRA):
    """Import a module; the test skips where it is missing, or a library of the system that it loads."""
    try:
        return import_module(name)
    except (ImportError, OSError) as error:
        reason = f"{name} cannot be imported ({error}); install it with: {install}"
        pytest.skip(reason, allow_module_level=True)


def optional_program(*names, install):
    """Return the path of a program that has one of these names; the test skips where there is none."""
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        reason = f"{' or '.join(names)} is not installed; install it with: {install}"
        pytest.skip(reason, allow_module_level=True)
    return found
