"""Which tests call a function and how long they take, as a plugin of pytest writes it down: the tests of a fault.

One run of all tests with ``-p tests.mutants.calls`` writes a file per process into the folder that ``CALLS`` names.
"""

import ast
import json
import os
import re
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.mutants.place import MODULE, function_spans

PACKAGES = ("collalign", "data_tools", "pairwise")
#: The variable that names the folder, and for how many seconds the tests of one fault may take without it.
CALLS, ENOUGH_S = "MUTANTS_CALLS", 60.0


class Recorder:
    """Notes the code that every test and every fixture called, and what a test took."""

    def __init__(self):
        self.tests = {}
        self._called = [set()]
        self._of_fixtures = {}

    def _note(self, frame, event, _):
        if event == "call":
            self._called[-1].add(frame.f_code)

    @contextmanager
    def _noting(self):
        self._called.append(set())
        sys.setprofile(self._note)
        threading.setprofile(self._note)
        try:
            yield self._called[-1]
        finally:
            called = self._called.pop()
            if len(self._called) == 1:
                sys.setprofile(None)
                threading.setprofile(None)
            else:
                self._called[-1] |= called

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        with self._noting() as called:
            result = yield
        self._of_fixtures.setdefault(id(fixturedef), set()).update(called)
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item):
        with self._noting() as called:
            result = yield
        made = [one for found in item._fixtureinfo.name2fixturedefs.values() for one in found]
        codes = called.union(*(self._of_fixtures.get(id(one), set()) for one in made))
        self.tests.setdefault(item.nodeid, {})["calls"] = sorted(set(_functions(codes)))
        return result

    def pytest_runtest_logreport(self, report):
        if report.nodeid in self.tests:
            one = self.tests[report.nodeid]
            one["seconds"] = one.get("seconds", 0.0) + report.duration
            one["passed"] = one.get("passed", True) and report.passed

    def pytest_sessionfinish(self):
        name = f"{os.environ.get('PYTEST_XDIST_WORKER', 'alone')}.json"
        Path(os.environ[CALLS], name).write_text(json.dumps(self.tests))


def _functions(codes):
    for code in codes:
        found = re.search(rf".*/((?:{'|'.join(PACKAGES)})/.*\.py)$", code.co_filename)
        if found:
            yield f"{found[1]} {code.co_qualname.split('.<locals>')[0]}"


def pytest_configure(config):
    """Note calls in every process that runs tests."""
    config.pluginmanager.register(Recorder())


class Calls:
    """What was written down, and the tests that a fault is shown to."""

    def __init__(self, folder, root):
        read = [json.loads(file.read_text()) for file in sorted(folder.glob("*.json"))]
        self._tests = {
            name: one for found in read for name, one in found.items() if one.get("passed")
        }
        self._sources = {
            str(path.relative_to(root)): path.read_text("utf-8")
            for package in PACKAGES
            for path in sorted((root / package).rglob("*.py"))
        }

    def tests_of(self, mutant, near):
        """Return the tests that call what the fault changes, of the files ``near`` first, the quickest first."""
        called = self._users(mutant)
        order = sorted(
            (name.split("::")[0] not in near, one["seconds"], name)
            for name, one in self._tests.items()
            if called & set(one["calls"])
        )
        chosen, total = [], 0.0
        for _, seconds, name in order:
            total += seconds
            if chosen and total > ENOUGH_S:
                continue
            chosen.append(name)
        return tuple(chosen)

    def _users(self, mutant):
        """The function; of what stands outside of all, the functions that use its names."""
        if mutant.function != MODULE:
            return {f"{mutant.file} {mutant.function}"}
        source, line = self._sources[mutant.file], mutant.line + 1
        last = line + mutant.old.count("\n")
        names = [
            name.id if isinstance(name, ast.Name) else name.name
            for node in ast.parse(source).body
            if node.lineno <= last and line <= int(node.end_lineno or 0)
            for name in [node, *ast.walk(node)]
            if isinstance(name, ast.ClassDef)
            or (isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store))
        ]
        word = (
            re.compile(rf"\b({'|'.join(map(re.escape, names))})\b") if names else re.compile("(?!)")
        )
        return {
            f"{file} {name}"
            for file, text in self._sources.items()
            if word.search(text)
            for name, (first, end) in function_spans(ast.parse(text)).items()
            if name.split(".")[0] in names or word.search("\n".join(text.split("\n")[first:end]))
        }
