"""What tests ask of notes: their codes, and the one of a code."""

from data_tools.notes import Note


def codes(notes):
    """Return the codes of notes, given as such or as JSON holds them."""
    return [note.code if isinstance(note, Note) else note["code"] for note in notes]


def only(notes, code):
    """Return the one note of a code."""
    (found,) = [note for note in notes if note.code == code]
    return found
