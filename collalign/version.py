"""The version of the installed package; a module of its own, since looking it up takes most of an import's time."""

from importlib.metadata import version

__version__ = version("collalign")
