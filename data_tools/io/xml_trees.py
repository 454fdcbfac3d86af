"""XML from anybody: nothing that a document declares is expanded or opened."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from data_tools.errors import InputError


def parse_xml(path: Path, content: bytes, *, encoding: str | None = None) -> ElementTree.Element:
    """Return the root of an XML file.

    Parameters
    ----------
    path : Path
        For messages.
    content : bytes
    encoding : str, optional
        Counts more than what the file says of itself.

    Raises
    ------
    InputError
        If it is damaged, or its document type declares anything or is kept in another file. MeshLab writes the mere
        name of a type.
    """

    def refuse_declarations(name: str, system: str | None, public: str | None, inside: int) -> None:
        if system is not None or public is not None or inside:
            raise InputError(
                f"{path}: has a DOCTYPE with declarations, which could fill the memory or open other files. "
                "It is not read; remove the declarations"
            )

    parser, tree = expat.ParserCreate(encoding), ElementTree.TreeBuilder()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse_declarations
    parser.StartElementHandler = tree.start
    parser.EndElementHandler = tree.end
    parser.CharacterDataHandler = tree.data
    try:
        parser.Parse(content, True)
        return tree.close()
    except InputError:
        raise
    except (expat.ExpatError, ValueError, LookupError, AssertionError):
        raise InputError(
            f"{path}: damaged or truncated, its XML cannot be read; get or save the file again"
        ) from None
