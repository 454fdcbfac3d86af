"""What a file or a word says reaches its option unchanged, or is refused by name."""

import pytest

from tests.commands import run_command


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "a.ply").write_text("no shape")
    return tmp_path / "shapes"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sampling = 5\n", ("'sampling'", "[sampling]")),
        ("[[sampling]]\nnum_points = 24\n", ("'sampling'", "[sampling]")),
        ("[sampling]\nnum_points = 24.7\n", ("[sampling][num_points]", "integer", "24.7")),
        ("[sampling]\nnum_points = 24.0\n", ("[sampling][num_points]", "integer", "24.0")),
        ("[sampling]\nseed = 24\n", ("[sampling][seed]",)),
        ("[matching]\nseed = 24\n", ("[matching][seed]",)),
        ("sed = 24\n", ("there is no option [sed]; did you mean 'seed'?",)),
        (
            "[sampling]\nnum_pionts = 24\n",
            ("[sampling][num_pionts]", "did you mean 'sampling.num-points'?"),
        ),
        (
            "[smapling]\nnum_points = 24\n",
            ("[smapling][num_points]", "did you mean 'sampling.num-points'?"),
        ),
        ("[align]\nseed = 24\n", ("'align'", "top level")),
        ("verbose = true\n", ("'verbose'", "command line")),
        ("seed = 123456789012345678901234567890\n", ("seed", "2^63")),
        ("a = " + "[" * 5000 + "]" * 5000, ("nested too deeply",)),
    ],
)
def test_entries_that_would_be_ignored_or_changed_are_refused(text, words, folder):
    config = folder.parent / "c.toml"
    config.write_text(text)
    said = "".join(
        run_command("--config", config, "align", folder, "--out", folder.parent / "out", ends=2)
    )
    assert all(word in said for word in words), said
    assert "readable shapes" not in said, "the entry was taken"


@pytest.mark.parametrize(
    ("flags", "word"),
    [
        (["--sampling.num-points", "24.7"], "--sampling.num-points: expected an integer, got 24.7"),
        (["--jobs", "1.5"], "--jobs: expected an integer"),
        (["--seed", "123456789012345678901234567890"], "seed: expected an integer from 0 to 2^63"),
        (["--memory-limit-gib", "1e300"], "memory_limit_gib: expected"),
        (["--pair-time-limit-s", "1e300"], "pair_time_limit_s: expected"),
        (["--matching.seed", "3"], "--matching.seed"),
    ],
)
def test_numbers_that_cannot_be_meant_are_refused(flags, word, folder):
    said = run_command("align", folder, "--out", folder.parent / "out", *flags, ends=2)
    assert word in "".join(said)
