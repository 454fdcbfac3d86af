"""Folders into which results are written and in which nothing of anybody else's is overwritten or deleted.

A manifest inside the folder says which files were written here, by which command and with which content. Only these
are ever replaced or removed, and only by their own command; whatever else lies there, or was changed since, is
somebody else's. That is checked before anything is written. A file that is changed between that check and the moment
in which it is replaced is kept under another name.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from data_tools.errors import InputError, printable
from data_tools.io.files import open_regular, read_text, resolved, system_reason, write_atomic
from data_tools.io.locks import LockFile
from data_tools.io.text_tables import csv_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Folder, inside of an output folder, that holds the manifest, the lock and what is not finished yet.
BOOKS = ".collalign"
MANIFEST_FILE = "manifest.json"
_MANIFEST_VERSION = 1
#: Folder, next to the manifest, of what outputs take the place of, until it is known whose that is.
_FORMER = "former"
_LOG = logging.getLogger(__name__)
#: Longest name that common file systems take, in bytes.
_MAX_NAME_BYTES = 255

#: Path, relative and with slashes, to ``{"writer": command, "digests": [SHA-256 of what may lie there]}``.
Entries = dict[str, dict[str, Any]]


def output_path(folder: Path, *parts: str) -> Path:
    """Return the path of an output: every path that is written to is made here.

    Parameters
    ----------
    folder : Path
    *parts : str
        Names of folders and, at the end, of the file.

    Raises
    ------
    InputError
        If a part is not one plain name, or the path leads out of the folder, for instance through a link.
    """
    for part in parts:
        if not part or part in (".", "..") or re.search(r"[/\\\x00]", part):
            raise InputError(
                f"{folder}: {part!r} cannot be the name of an output, it is not one plain name"
            )
        try:
            length = len(os.fsencode(part))
        except UnicodeEncodeError:
            raise InputError(
                f"{folder}: {part[:60]!r} cannot be the name of an output in this locale; set PYTHONUTF8=1"
            ) from None
        if length > _MAX_NAME_BYTES:
            raise InputError(
                f"{folder}: {part[:60]!r}... cannot be the name of an output, it is too long"
            )
    path = folder.joinpath(*parts)
    if not resolved(path.parent).is_relative_to(resolved(folder)):
        raise InputError(f"{path}: leads out of {folder}, through a link; nothing is written there")
    return path


def written_files(folder: Path, writer: str) -> list[str]:
    """Return what the manifest of a folder of results lists of one command, relative to the folder, by name.

    Raises
    ------
    InputError
        If the manifest is damaged.
    """
    return sorted(
        name
        for name, entry in OutputFolder(folder, writer)._entries().items()
        if entry["writer"] == writer
    )


class OutputFolder:
    """One folder of results while one run writes to it; get it with :meth:`open`.

    Attributes
    ----------
    folder : Path
    staging : Path
        Where outputs are written first; :meth:`publish` moves them into place.
    """

    def __init__(self, folder: Path, writer: str) -> None:
        self.folder = folder
        self.staging = folder / BOOKS / "staging"
        self._writer = writer
        self._manifest = folder / BOOKS / MANIFEST_FILE
        self._is_moving = False

    @classmethod
    @contextmanager
    def open(
        cls, folder: Path | str, *, writer: str, inputs: Iterable[Path] = ()
    ) -> Iterator[OutputFolder]:
        """Hold a folder for one run; it is made if it does not exist.

        Parameters
        ----------
        folder : path
        writer : str
            The command that writes, for instance ``align``, and behind a blank what it writes where there are several
            kinds.
        inputs : iterable of Path
            Files and folders that are read: none may lie in the folder or around it.

        Raises
        ------
        InputError
            If another run holds it, it cannot be written, or an input lies in it or around it.
        """
        folder = Path(folder)
        refuse_overlap(folder, inputs)
        output = cls(folder, writer)
        lock = _lock(folder)
        try:
            output._go_on()
            output._is_moving = False
            with suppress(InputError):  # of a damaged manifest
                output._clear_former(output._entries())
            shutil.rmtree(
                output.staging, ignore_errors=True
            )  # of a run that was killed: nobody else has the lock
            output._make_staging()
            yield output
        finally:
            if not output._is_moving:
                shutil.rmtree(output.staging, ignore_errors=True)
            lock.release()
            with suppress(OSError):  # nothing was published
                lock.path.parent.rmdir()

    def stage(self, *parts: str) -> Path:
        """Return where to write an output for now; its folder exists."""
        path = output_path(self.staging, *parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def stage_text(self, text: str, *parts: str) -> Path:
        """Stage a text in UTF-8, in which names of files that are no text are escaped."""
        return write_atomic(self.stage(*parts), text.encode("utf-8", "backslashreplace"))

    def stage_table(self, rows: Iterable[Iterable[object]], *parts: str) -> Path:
        """Stage a table as CSV."""
        return self.stage_text(csv_text(rows), *parts)

    def stage_picture(self, figure: Figure, *parts: str) -> Path:
        """Stage a figure as PNG, the same bytes every time."""
        path = self.stage(*parts)
        figure.savefig(path, format="png", metadata={"Software": None})
        return path

    def published(self, staged: Path) -> Path:
        """Return where a staged output ends up."""
        return self.folder / staged.relative_to(self.staging)

    def refuse_foreign(self, names: Iterable[str]) -> None:
        """Refuse to go on where a name of an output, relative to the folder, belongs to others or to another command.

        Raises
        ------
        InputError
            Naming the file.
        """
        entries = self._entries()
        for name in names:
            path = output_path(self.folder, *PurePosixPath(name).parts)
            above = [
                p
                for p in path.parents
                if self.folder in p.parents and p.exists() and not p.is_dir()
            ]
            path = above[0] if above else path  # a file where a folder belongs
            if not os.path.lexists(path):
                continue
            if above or not _is_ours(path, entries.get(name)):
                raise InputError(
                    f"{path}: is in the place of a result. It was not written by this program, or was changed "
                    f"since. Move it away, or {_ADVICE}"
                )
            writer = entries[name]["writer"]
            if writer.split(" ")[0] != self._writer.split(" ")[0]:
                raise InputError(
                    f"{path}: is in the place of a result, and was written by `{writer}`; {_ADVICE}"
                )

    def publish(self, *, last: str | None = None, complete: bool = False) -> tuple[Path, ...]:
        """Move everything staged into place.

        What lies in the place of an output is moved aside, and removed at the end if it is what was written here. If
        not, somebody changed it since the check: it is kept under another name, and the log says so. Whenever this is
        interrupted, the manifest knows every file of ours by its former or its new content, and the next :meth:`open`
        moves the rest.

        Parameters
        ----------
        last : str, optional
            The output that says that the others are complete: it goes first and comes back last.
        complete : bool
            Remove what the same command wrote earlier and does not write any more.

        Returns
        -------
        tuple of Path
            What was written, ``last`` first, the others by name.

        Raises
        ------
        InputError
            If a file that is not ours is in the way; nothing has been changed then.
        """
        staged = sorted(
            p.relative_to(self.staging).as_posix()
            for p in self.staging.rglob("*")
            if not p.is_dir()
        )
        self.refuse_foreign(staged)
        entries = self._entries()
        fresh: Entries = {
            name: {"writer": self._writer, "digests": [_digest(self.staging / name)]}
            for name in staged
        }
        stale = [
            n
            for n, e in entries.items()
            if complete and e["writer"] == self._writer and n not in fresh
        ]
        self._write_manifest(
            _either(entries, fresh), pending={"new": staged, "stale": stale, "last": last}
        )
        self._move(entries, fresh, stale, last)
        return tuple(
            self.folder / name for name in sorted(staged, key=lambda name: (name != last, name))
        )

    def _move(
        self, entries: Entries, fresh: Entries, stale: Iterable[str], last: str | None
    ) -> None:
        """Move what is still staged, ``last`` at the end, remove what is stale, and close the books."""
        self._is_moving = True
        waiting = [name for name in fresh if (self.staging / name).exists()]
        for name in [*(name for name in waiting if name == last), *stale]:
            if _is_ours(self._path(name), entries.get(name)):
                self._set_aside(name)
        for name in sorted(waiting, key=lambda name: (name == last, name)):
            path = self._path(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._set_aside(name)
            while not _moved(self.staging / name, path):
                self._set_aside(name)
        self._clear_former(_either(entries, fresh))
        for name in stale:
            with suppress(OSError):  # it holds something else
                if "/" in name:
                    (self.folder / name).parent.rmdir()
        kept = {name: entry for name, entry in entries.items() if name not in stale}
        self._write_manifest(kept | fresh)
        self._is_moving = False

    def _go_on(self) -> None:
        """Finish the publication of a run that was killed halfway, if all of it is there; otherwise leave it."""
        # Whoever publishes next reports a damaged manifest and files of others.
        with suppress(InputError, TypeError, KeyError):
            entries, pending = self._entries(), self._read_manifest()["pending"]
            new, stale = (
                [name for name in pending[key] if name in entries] for key in ("new", "stale")
            )
            fresh = {
                name: entries[name] | {"digests": entries[name]["digests"][-1:]} for name in new
            }
            for name, entry in fresh.items():
                place = output_path(self.staging, *PurePosixPath(name).parts)
                place = place if place.exists() else self.folder / name
                if place.is_symlink() or [_digest(place)] != entry["digests"]:
                    return
            for writer in {entry["writer"] for entry in fresh.values()}:
                OutputFolder(self.folder, writer).refuse_foreign(fresh)
            self._move(entries, fresh, stale, pending["last"])

    def _make_staging(self) -> None:
        try:
            self.staging.mkdir()
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written ({system_reason(error)})") from None

    def _path(self, name: str) -> Path:
        """Return the place of an output, relative to the folder."""
        return output_path(self.folder, *PurePosixPath(name).parts)

    def _set_aside(self, name: str) -> None:
        """Move whatever is in the place of an output to where nobody looks for it, under a number that is free."""
        numbered = (self._path(f"{BOOKS}/{_FORMER}/{number}/{name}") for number in count())
        place = next(place for place in numbered if not os.path.lexists(place))
        if os.path.lexists(self._path(name)):
            place.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):  # it was moved away just now
                os.rename(self._path(name), place)

    def _clear_former(self, entries: Entries) -> None:
        """Remove what was set aside and is ours, and put back the rest, under another name if its own is taken."""
        former = self._path(f"{BOOKS}/{_FORMER}")
        if not former.is_dir():
            return
        for number in sorted(former.iterdir(), key=lambda path: (len(path.name), path.name)):
            for name, entry in entries.items():
                place = self._path(f"{BOOKS}/{_FORMER}/{number.name}/{name}")
                if _is_ours(place, entry):
                    place.unlink()
                elif os.path.lexists(place):
                    _put_back(place, self._path(name))
        for folder in [*sorted(former.rglob("*"), reverse=True), former]:
            with suppress(OSError):  # what the manifest does not name stays
                folder.rmdir()

    def _entries(self) -> Entries:
        """Return what the manifest lists; nothing in it is trusted to be well-formed or to stay in the folder."""
        content = self._read_manifest()
        files = content.get("files")
        if not isinstance(files, dict) or content.get("version") != _MANIFEST_VERSION:
            raise InputError(f"{self._manifest}: not a manifest of this version; {_ADVICE}")
        for name, entry in files.items():
            output_path(self.folder, *PurePosixPath(name).parts)
            digests = entry.get("digests") if isinstance(entry, dict) else None
            if not isinstance(digests, list) or not isinstance(entry.get("writer"), str):
                raise InputError(f"{self._manifest}: {name!r} is malformed; {_ADVICE}")
        return files

    def _read_manifest(self) -> dict[str, Any]:
        if not os.path.lexists(self._manifest):
            return {"version": _MANIFEST_VERSION, "files": {}}
        try:
            content = json.loads(read_text(self._manifest))
        except (ValueError, RecursionError) as error:
            raise InputError(f"{self._manifest}: cannot be read ({error}); {_ADVICE}") from None
        return content if isinstance(content, dict) else {}

    def _write_manifest(self, entries: Mapping[str, Any], **pending: Any) -> None:
        content = {"version": _MANIFEST_VERSION, "files": dict(sorted(entries.items())), **pending}
        write_atomic(self._manifest, json.dumps(content, indent=1).encode())


_ADVICE = "name another folder for the results"


def _is_ours(path: Path, entry: Mapping[str, Any] | None) -> bool:
    """Return whether a path is a regular file whose content the entry of an output names."""
    if entry is None or path.is_symlink() or not path.is_file():
        return False
    return _digest(path) in entry["digests"]


def _moved(source: Path, path: Path) -> bool:
    """Move a file to a path where nothing is; return False, and leave both, where something is."""
    try:
        if source.is_symlink():
            raise PermissionError  # a link to it would be one to its target on some systems
        os.link(source, path)  # unlike a rename, it fails where something is
    except FileExistsError:
        return False
    except OSError:  # folders, and file systems without hard links
        if os.path.lexists(path):
            return False
        os.rename(source, path)
        return True
    source.unlink()
    return True


def _put_back(source: Path, path: Path) -> None:
    """Move what somebody else wrote back to its path, or to a name that is free if that is taken."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if _moved(source, path):
        return
    names = (f"{path.stem}-changed{n if n > 1 else ''}{path.suffix}" for n in count(1))
    kept = next(name for name in names if _moved(source, path.with_name(name)))
    _LOG.warning(
        printable(f"{path}: was changed while results were written. Your version is kept as {kept}")
    )


def _either(entries: Entries, fresh: Entries) -> Entries:
    """Return entries under which former and new contents both are ours."""
    former = {name: entry["digests"] for name, entry in entries.items()}
    both = {
        name: {"writer": entry["writer"], "digests": [*former.get(name, []), *entry["digests"]]}
        for name, entry in fresh.items()
    }
    return entries | both


def _digest(path: Path) -> str:
    with open_regular(path, sys.maxsize) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _lock(folder: Path) -> LockFile:
    """Make the folder and hold its lock, which the system frees however the run ends."""
    books = folder / BOOKS
    try:
        books.mkdir(parents=True, exist_ok=True)
        if books.is_symlink():
            raise InputError(f"{books}: is a link; {_ADVICE}")
        return LockFile.take(books / "lock")
    except BlockingIOError:
        raise InputError(
            f"{folder}: another run is writing to it; wait for it, or {_ADVICE}"
        ) from None
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written or locked ({system_reason(error)})"
        ) from None


def refuse_overlap(folder: Path, inputs: Iterable[Path]) -> None:
    """Refuse an output folder that holds an input or lies inside of one, through links and bind mounts as well.

    Raises
    ------
    InputError
        Naming both.
    """
    out, around_out = _places(folder)
    for given in inputs:
        source, around_source = _places(given)
        contains, inside = bool(out & around_source), bool(source & around_out)
        if contains or inside:
            place = "is" if contains and inside else "contains" if contains else "lies inside of"
            raise InputError(
                f"{folder}: {place} {given}, the input; name a folder apart from it for the results, or results "
                "and originals get mixed up"
            )


def _places(path: Path) -> tuple[set[object], set[object]]:
    """Return what tells a path, by its name and by device and inode, and what tells it and the folders around it."""
    own = resolved(path)
    marks: list[set[object]] = []
    for place in (own, *own.parents):
        marks.append({place})
        with suppress(OSError):
            found = place.stat()
            marks[-1].add((found.st_dev, found.st_ino))
    return marks[0], set().union(*marks)
