"""What ``collalign open`` shows of a result, and the commands that it runs on its files."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from subprocess import PIPE, STDOUT, Popen, TimeoutExpired
from threading import Lock, Thread
from typing import Any, BinaryIO

from collalign.analysis.label_table import read_labels
from collalign.options import ALL, AUTO, NEVER, AlignOptions
from collalign.output.collection import Collection
from collalign.output.corrections import fixed_by, read_corrections
from collalign.output.loading import load
from collalign.output.moved_files import missing_files
from collalign.output.provenance import option_words, shape_words
from collalign.output.write import ALIGNMENT_FILE, REPORT_FILE
from collalign.template_landmarks.templates import read_templates
from collalign.tools.export.run import FORMATS
from data_tools.errors import InputError
from data_tools.io.files import resolved
from data_tools.io.listing import FolderListing, read_folder
from data_tools.io.output_folder import OutputFolder, output_path
from data_tools.io.source import location
from data_tools.io.text_tables import csv_text
from data_tools.landmark_tables import READABLE
from data_tools.names import known_names
from data_tools.notes import listed

#: Pages that are shown, by the command that writes them.
_PAGES = {
    "align": REPORT_FILE,
    "variation": "variation/variation.html",
    "transfer": "landmarks/landmarks.html",
}
#: Folder with what came from the browser, that of landmarks in it, and files whose names say what they are. The
#: folder has a manifest of its own: a file there that is somebody else's is never overwritten.
_GIVEN, _TEMPLATES = "given", "templates"
#: The command, in the manifest of that folder.
_WRITER = "open"
_DECISIONS_FILE, _LABELS_FILE, _CORRECTED_FILE = "decisions.json", "labels.csv", "templates.csv"
#: Files that may be tables of labels.
_TABLES = (".csv", ".tsv", ".txt")
_SOURCES_FILE = "sources.txt"
#: What Python runs for a command: it ends in order when this process is gone, however that has ended.
_BELOW = """
import os, signal, sys
from collalign.cli import main
from collalign.engine.worker import end_with_parent
end_with_parent(int(sys.argv.pop(1)), lambda: os.kill(os.getpid(), signal.SIGTERM))
sys.exit(main())
"""
#: How long a command may take to end in order.
_LEAVE_TO_END_S = 20.0


class Workspace:
    """A result, or a folder of shapes that will have one next to it; nothing else is read or written."""

    def __init__(self, place: Path, sources: Path | None = None) -> None:
        self._shapes, self.out = resolved(place), resolved(place)
        if not (place / ALIGNMENT_FILE).is_file():  # shapes: their result goes beside them
            read_folder(place)
            self.out = self.out.with_name(f"{self.out.name}-aligned")
        self._process: Popen[str] | None = None
        self._starting, self._keeping = Lock(), Lock()
        self._command, self._lines = "", deque[str](maxlen=500)
        if sources is not None:
            content = str(resolved(sources)).encode("utf-8", "surrogateescape")
            self.put(_SOURCES_FILE, BytesIO(content))

    def state(self) -> dict[str, Any]:
        """Return shapes, pages, formats and files that were given; JSON types only."""
        pages = {task: page for task, page in _PAGES.items() if (self.out / page).is_file()}
        state: dict[str, Any] = {
            "out": str(self.out),
            "pages": pages,
            "formats": list(FORMATS),
            "aligned": False,
            "found": "",
            "shapes": [],
            "byHand": [],
            "missing": [],
        }
        if not (self.out / ALIGNMENT_FILE).is_file():
            listing = read_folder(self._shapes)
            shapes = [
                {"name": name, "exclude": False, "incomplete": False} for name in listing.names
            ]
            return state | {"found": _found(listing), "shapes": shapes}
        collection = self._load()
        left_out, incomplete = _left_out(collection), _incomplete(collection)
        shapes = [
            {"name": name, "exclude": name in left_out, "incomplete": name in incomplete}
            for name in (*collection.names, *left_out)
        ]
        return state | {
            "aligned": True,
            "shapes": shapes,
            "byHand": [*collection.by_hand],
            "missing": missing_files(collection.files),
        }

    def page(self, name: str) -> Path | None:
        """Return the file of a page, None if it is none of ours or leads out of the result."""
        if name not in _PAGES.values() and not re.fullmatch(r"report_pages/page-\d+\.html", name):
            return None
        file = resolved(self.out / name)
        return file if file.is_file() and file.is_relative_to(resolved(self.out)) else None

    def put(self, name: str, content: BinaryIO) -> dict[str, str]:
        """Keep decisions, labels, where the files are now, or landmarks, which become templates.

        A table that holds no landmarks is one of labels, whatever it is called, if it names a shape.

        Parameters
        ----------
        name : str
            Of the file.
        content : file
            Which can be read again from its beginning.

        Returns
        -------
        dict
            Under ``kept``, the kind of file that it was kept as.

        Raises
        ------
        InputError
            Saying what is wrong with the content.
        """
        collection = load(self.out)
        names = collection.names

        def check_landmarks(staged: Path) -> None:
            if others := sorted({*read_templates([staged], names)} - {*names}):
                raise InputError(
                    f"{name}: {others[0]!r} is no shape of the collection; call the file like its shape"
                )

        def check_labels(staged: Path) -> None:
            read_labels(staged).check_fit(names)

        checks: dict[str, Callable[[Path], object]] = {
            _DECISIONS_FILE: lambda staged: fixed_by([read_corrections(staged)], names),
            _LABELS_FILE: check_labels,
            _SOURCES_FILE: lambda staged: collection.with_sources(_folder_in(staged.read_bytes())),
        }
        if name in checks:
            self._keep((name,), content, checks[name])
            return {"kept": Path(name).stem}
        try:
            self._keep((_TEMPLATES, name), content, check_landmarks)
        except InputError as no_landmarks:
            if Path(name).suffix.lower() not in _TABLES:
                raise
            try:
                self._keep((_LABELS_FILE,), content, check_labels)
            except InputError:
                raise no_landmarks from None
            return {"kept": "labels"}
        return {"kept": "landmarks"}

    def words(self, task: str, request: Mapping[str, Any]) -> list[str]:
        """Return the command line of a task, with names to ``exclude`` or ``incomplete`` ones, or a ``format``."""
        out = str(self.out)
        if task == "align" and not (self.out / ALIGNMENT_FILE).is_file():
            return ["align", str(self._shapes), f"--out={out}", *self._first_words(request)]
        collection = self._load()
        names = {*collection.names, *_left_out(collection)}
        request = _with_names(request, names)
        exclude = request.get("exclude") or ()
        counted = [f"--exclude={name}" for name in exclude if name in collection.names]
        if task == "align":
            usual, decisions = collection.options.incomplete, self.out / _GIVEN / _DECISIONS_FILE
            named = {*request.get("incomplete", _incomplete(collection))} - {*exclude}
            is_usual = usual in (ALL, AUTO, NEVER) and named == _incomplete(collection)
            incomplete = usual if is_usual else ",".join(sorted(named)) or NEVER
            options = option_words(replace(collection.options, incomplete=incomplete))
            words = [
                *shape_words(collection)[0],
                f"--out={out}",
                *options,
                *self._labels(collection),
            ]
            words += [f"--corrections={decisions}"] if decisions.is_file() else []
            return ["align", *words, *(f"--exclude={name}" for name in exclude)]
        if task == "variation":
            return ["variation", out, *self._labels(collection), *counted, *self._sources()]
        if task == "transfer":
            return [
                "transfer",
                out,
                "--landmarks",
                *self._templates(collection),
                f"--to={out}/landmarks",
                *self._sources(),
            ]
        if task != "export" or request.get("format") not in FORMATS:
            raise InputError(f"{task}: there is no such command or format here")
        to = f"--to={out}/export-{request['format']}"
        return ["export", out, f"--format={request['format']}", to, *counted, *self._sources()]

    def _first_words(self, request: Mapping[str, Any]) -> list[str]:
        """Return the options of a first alignment."""
        names = read_folder(self._shapes).names
        request = _with_names(request, names)
        kept = {key: request[key] for key in ("group", "scaling") if key in request}
        named = ",".join(
            sorted({*(request.get("incomplete") or ())} - {*(request.get("exclude") or ())})
        )
        options = AlignOptions(**kept, incomplete=named or AUTO)
        return [
            *option_words(options),
            *(f"--exclude={name}" for name in request.get("exclude") or ()),
        ]

    def start(self, task: str, request: Mapping[str, Any]) -> None:
        """Run the command of :meth:`words` in a process of its own, one at a time."""
        with self._starting:  # requests come in threads of their own
            if self._process is not None and self._process.poll() is None:
                raise InputError("a command is running; wait for its end, or stop it")
            words = self.words(task, request)
            self._command, self._lines = shlex.join(["collalign", *words]), deque(maxlen=500)
            variables = {"PYTHONUNBUFFERED": "1", "PYTHONUTF8": "1"}
            self._process = Popen(
                [sys.executable, "-c", _BELOW, str(os.getpid()), *words],
                stdout=PIPE,
                stderr=STDOUT,
                encoding="utf-8",
                errors="replace",
                env=os.environ | variables,
            )
            Thread(target=self._lines.extend, args=(self._process.stdout,), daemon=True).start()

    def stop(self) -> None:
        """End the command that runs, in order if it does so in time; what it has finished is kept in the store."""
        with self._starting:
            if self._process is not None:
                self._process.terminate()
                try:
                    self._process.wait(_LEAVE_TO_END_S)
                except TimeoutExpired:
                    self._process.kill()
                    self._process.wait()

    def progress(self) -> dict[str, Any]:
        """Return the last command, what it has said, and its exit code, None while it runs; JSON types only."""
        code = None if self._process is None else self._process.poll()
        return {"command": self._command, "lines": [*self._lines.copy()], "code": code}

    def _keep(
        self, parts: Sequence[str], content: BinaryIO, check: Callable[[Path], object] | None = None
    ) -> None:
        """Put a file into the folder of what was given, if ``check`` finds nothing wrong with it."""
        with self._keeping, OutputFolder.open(self.out / _GIVEN, writer=_WRITER) as given:
            staged = given.stage(*parts)
            content.seek(0)
            with staged.open("wb") as file:
                shutil.copyfileobj(content, file)
                file.flush()
                os.fsync(file.fileno())
            if check is not None:
                try:
                    check(staged)
                except InputError as error:  # the staged copy is nobody's file
                    raise InputError(str(error).replace(str(staged), parts[-1])) from None
            given.publish()

    def _load(self) -> Collection:
        """Return the result, its files where they are now."""
        given = output_path(self.out, _GIVEN, _SOURCES_FILE)
        return load(self.out, sources=_folder_in(given.read_bytes()) if given.is_file() else None)

    def _sources(self) -> list[str]:
        """Return the option that says where the files are now, if that was said."""
        given = output_path(self.out, _GIVEN, _SOURCES_FILE)
        return [f"--sources={_folder_in(given.read_bytes())}"] if given.is_file() else []

    def _labels(self, collection: Collection) -> list[str]:
        """Return the option of labels that were given in the browser or with an earlier command."""
        path = output_path(self.out, _GIVEN, _LABELS_FILE)
        if not path.is_file() and collection.labels:
            rows = zip(collection.names, *collection.labels.values(), strict=True)
            text = csv_text([["name", *collection.labels], *rows])
            self._keep((_LABELS_FILE,), BytesIO(text.encode("utf-8", "backslashreplace")))
        return [f"--labels={path}"] if path.is_file() else []

    def _templates(self, collection: Collection) -> list[str]:
        """Return the landmark files: what was corrected on the page goes before what was given for a specimen."""
        files = sorted(
            (self.out / _GIVEN / _TEMPLATES).glob("*"),
            key=lambda file: file.name != _CORRECTED_FILE,
        )
        corrected = {*read_templates(files[:1], collection.names)}
        chosen = files[:1] + [
            file
            for file in files[1:]
            if not {*read_templates([file], collection.names)} & corrected
        ]
        if not chosen:
            raise InputError(
                f"give landmarks of a specimen first ({READABLE}), called like its file"
            )
        return [str(file) for file in chosen]


def _found(listing: FolderListing) -> str:
    """Say what a folder holds."""
    kinds = Counter(
        Path(location(file)).suffix.lower().removeprefix(".") or "folder" for file in listing.files
    )
    counts = ", ".join(f"{number} {kind}" for kind, number in kinds.most_common())
    skipped = f" Not shapes: {listed(listing.skipped_names)}." if listing.skipped_names else ""
    return f"{len(listing.files)} shapes ({counts}).{skipped}"


def _folder_in(content: bytes) -> Path:
    """Return the folder that a page, or an earlier page, gave."""
    return Path(content.decode("utf-8", "surrogateescape").strip()).expanduser()


def _with_names(request: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Return a request whose lists have names of shapes."""
    lists = (key for key in ("exclude", "incomplete") if request.get(key))
    return {**request, **{key: [*known_names(key, request[key], names).values()] for key in lists}}


def _left_out(collection: Collection) -> list[str]:
    """Return the names of the shapes that were left out; none where the files are not known."""
    try:
        return shape_words(collection)[1]
    except InputError:
        return []


def _incomplete(collection: Collection) -> set[str]:
    return {collection.names[one.shape] for one in collection.incomplete}
