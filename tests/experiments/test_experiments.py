"""The experiments' framework: cells are kept and resumed, tables compare, the committed page is made of its parts."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from collalign.engine.store import Store
from data_tools.errors import CollectionError, InputError
from experiments import NAMES, load_experiment
from experiments.__main__ import app
from experiments.experiment import Bench, Experiment, Outcome, Plot
from experiments.figures import theorem3
from experiments.tables import Column, Table, differences
from experiments.write import write_experiment, write_page

ROOT = Path(__file__).resolve().parents[2]
CALLS = []


def square(cell):
    CALLS.append(cell.settings["number"])
    if cell.settings["number"] < 0:
        raise ValueError("a negative number")
    return {"square": cell.settings["number"] ** 2}


def cells(*numbers):
    return {f"cell {number}": {"number": number} for number in numbers}


@pytest.fixture
def bench(tmp_path):
    CALLS.clear()
    return Bench(data=tmp_path / "data", store=Store.memory(), quiet=True)


def table(*rows):
    columns = (
        Column(key="name", title="name"),
        Column(key="share", title="share, %", format=".1f"),
        Column(key="seconds", title="s", format=".2f", clock=True),
    )
    return Table(columns=columns, rows=rows)


def test_finished_cells_are_not_computed_again(bench):
    assert bench.measure(square, cells(2, 3))["cell 3"] == {"square": 9}
    assert bench.measure(square, cells(2, 3, 4))["cell 4"] == {"square": 16}
    assert CALLS == [2, 3, 4]
    assert bench.num_reused == 2
    bench.measure(square, cells(2), version="2")
    assert CALLS == [2, 3, 4, 2]


def test_a_failed_cell_is_named_loses_nothing_and_is_tried_again(bench):
    with pytest.raises(CollectionError, match=r"cell -1: .*a negative number"):
        bench.measure(square, cells(5, -1, 6))
    with pytest.raises(CollectionError):
        bench.measure(square, cells(5, -1, 6))
    assert sorted(CALLS) == [-1, -1, 5, 6]


def test_resumed_files_are_those_of_a_fresh_run(bench, tmp_path):
    def measure(bench):
        records = bench.measure(square, cells(2, 3))
        rows = tuple({"name": name, "share": record["square"]} for name, record in records.items())
        plot = Plot(draw=lambda figure: figure.subplots().plot([1, 2]), title="a line")
        return Outcome(tables=(table(*rows),), plots=(plot,), text="Two cells.")

    experiment = Experiment(name="squares", title="Squares", about="Of numbers.", measure=measure)
    contents = []
    for folder in (tmp_path / "fresh", tmp_path / "resumed"):
        written = write_experiment(experiment, experiment.measure(bench), bench, folder)
        assert [file.name for file in written] == ["squares.csv", "squares.png", "squares.md"]
        contents.append([file.read_bytes() for file in written])
    assert contents[0] == contents[1]
    page = write_page(("squares", "missing"), tmp_path / "fresh").read_text("utf-8")
    assert "| [Squares](results/squares.md) | `python -m experiments squares` |" in page
    assert page.endswith("Not measured yet: `missing`.\n")
    details = tmp_path / "fresh" / "results" / "squares.md"
    assert "| cell 3 | 9.0 |  |" in details.read_text("utf-8")
    assert (
        details.parent / re.search(r"!\[a line\]\((.*?)\)", details.read_text("utf-8"))[1]
    ).is_file()


def test_differences_see_a_wrong_value_but_no_clock():
    text = table(
        {"name": "a", "share": 50.0, "seconds": 1.0}, {"name": "b", "share": math.nan}
    ).to_csv()
    assert differences(table({"name": "a", "share": 50.0 + 1e-9, "seconds": 7.0}), text) == []
    assert differences(table({"name": "b", "share": math.nan}), text) == []
    assert differences(table({"name": "a", "share": 50.1}), text)
    assert differences(table({"name": "b", "share": 50.0}), text)
    with pytest.raises(InputError, match="share"):
        differences(table({"name": "a", "share": 50.0}), "name\na\n")


@pytest.mark.parametrize("name", NAMES)
def test_every_experiment_loads_and_says_what_it_is(name):
    experiment = load_experiment(name)
    assert experiment.name == name
    assert experiment.title
    assert experiment.about.strip()


def test_the_command_writes_a_part_of_the_committed_results_again(tmp_path):
    assert (
        app(
            ["theorem3", "--quick", "--quiet", "--jobs", "1", "--out", str(tmp_path)],
            exit_on_error=False,
        )
        == 0
    )
    page = (tmp_path / "RESULTS.md").read_text("utf-8")
    assert "](results/theorem3.md) | `python -m experiments theorem3` |" in page
    assert "Not measured yet: `figure3`" in page
    with Store.open(tmp_path / ".cache" / "experiments.sqlite") as store:
        bench = Bench(data=tmp_path, store=store, quick=True, quiet=True)
        (found,) = theorem3.EXPERIMENT.measure(bench).tables
    assert bench.num_reused == len(found.rows) > 0
    committed = (ROOT / "results" / "theorem3.csv").read_text("utf-8")
    assert differences(found, committed) == []
    assert differences(found, committed.replace("chair,10,2,2", "chair,10,2,3"))


def test_the_committed_page_links_to_the_committed_sections(tmp_path):
    (tmp_path / "results").mkdir()
    for file in [*(ROOT / "results").glob("*.md"), *(ROOT / "results").glob("*.csv")]:
        assert file.suffix == ".csv" or file.stem in NAMES
        (tmp_path / "results" / file.name).write_bytes(file.read_bytes())
    assert write_page(NAMES, tmp_path).read_bytes() == (ROOT / "RESULTS.md").read_bytes()


@pytest.mark.data
@pytest.mark.parametrize("name", ["proofs"])
def test_the_quick_run_of_others_fills_their_tables(name, bench, shared_data):
    outcome = load_experiment(name).measure(replace(bench, data=shared_data, quick=True))
    assert all(table.rows for table in outcome.tables)
