from pathlib import Path

import pytest

from data_tools.errors import InputError
from data_tools.io.xml_trees import parse_xml
from tests.memory import most_memory

#: Ten entities, each ten times the one before.
LAUGHS = (
    "<!DOCTYPE a [<!ENTITY e0 'ha'>"
    + "".join(f"<!ENTITY e{n + 1} '{f'&e{n};' * 10}'>" for n in range(10))
    + "]><a>&e10;</a>"
)
DECLARED = {
    "entities": LAUGHS,
    "defaults": "<!DOCTYPE a [<!ATTLIST a b CDATA 'long'>]><a/>",
    "file": "<!DOCTYPE a SYSTEM 'file:///etc/passwd'><a/>",
    "public": "<!DOCTYPE a PUBLIC 'b' 'http://c'><a/>",
}


def test_a_tree_comes_back_whole():
    root = parse_xml(Path("a"), b"<!DOCTYPE a><a x='1'><b>one</b> &lt; <b/></a>")
    assert (root.tag, root.attrib, [one.text for one in root]) == ("a", {"x": "1"}, ["one", None])
    assert root[0].tail == " < "


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-16-be", "iso-8859-1"])
@pytest.mark.parametrize("kind", DECLARED)
def test_declarations_are_refused_in_any_encoding(kind, encoding):
    stated = encoding.removesuffix("-le").removesuffix("-be")
    head = "" if encoding == "utf-16" else f"<?xml version='1.0' encoding='{stated}'?>"
    mark = {"utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}.get(encoding, b"")
    content = mark + (head + DECLARED[kind]).encode(encoding)
    with most_memory(2**20), pytest.raises(InputError, match="has a DOCTYPE with declarations"):
        parse_xml(Path("a"), content)


@pytest.mark.parametrize(
    "content", [b"", b"a", b"<a>", b"<a/><b/>", b"<a>&b;</a>", b"\xff\xfe<", b"<a>\0</a>"]
)
def test_damage_is_named(content):
    with pytest.raises(InputError, match="its XML cannot be read"):
        parse_xml(Path("a.vtp"), content)


def test_the_encoding_that_is_known_counts_more_than_the_one_that_is_said():
    content = "<?xml version='1.0' encoding='UTF-16'?><a>é</a>".encode()
    assert parse_xml(Path("a"), content, encoding="utf-8").text == "é"
