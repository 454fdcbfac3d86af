"""Figure 5 of Maron et al. 2016: PM-SDP with local minimisation against an exhaustive search over O(d).

Q is uniform in the unit cube, P = R^T Q X plus Gaussian noise. The exhaustive search minimises from every one of some
thousand rotations; PM-SDP from the four starts of appendix A, and from 20 draws from (R, C).
Run with `python -m tests.benchmarks.bench_figure5 --out FOLDER`: writes figure5.png, figure5_histograms.csv and
figure5_runs.csv.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray
from pairwise.local_search import MatchingCosts, energies_of, minimise, procrustes
from pairwise.problem import Problem
from pairwise.rounding import appendix_starts, draw_rotations
from pairwise.solve import solve_pm_sdp
from pairwise.starts import random_rotations, rotation_set

SIGMAS = (0.0, 0.05, 0.1, 0.2)


def planted(num: int, dim: int, sigma: float, rng: np.random.Generator) -> Problem:
    """The paper's synthetic problem, R in O(d)."""
    target = rng.random((num, dim))
    turn = random_rotations(dim, 1, rng)[0]
    turn[:, 0] *= rng.choice([-1.0, 1.0])
    noise = sigma * rng.standard_normal(target.shape)
    return Problem.from_user(target, target[rng.permutation(num)] @ turn + noise, group="O")


def exhaustive_energies(problem: Problem, num: int) -> FloatArray:
    """Energies of the local minima that an even set of O(d) leads to, one per start."""
    rotations = rotation_set(problem.dim, num // 2)
    mirrored = rotations * np.r_[-1.0, np.ones(problem.dim - 1)]
    return minimise_each(problem, np.concatenate([rotations, mirrored]))


def minimise_each(problem: Problem, rotations: FloatArray) -> FloatArray:
    """Energies that alternating minimisation ends at from every start by itself: runs that meet go on apart."""
    rotations = rotations.copy()
    scales, costs = np.ones(len(rotations)), MatchingCosts(problem)
    maps = np.full((len(rotations), problem.num_source), -1)
    moving = np.arange(len(rotations))
    while len(moving):
        new = costs.assign(rotations[moving], scales[moving])
        changed = (new != maps[moving]).any(axis=1)
        maps[moving] = new
        rotations[moving] = procrustes(problem, new)[0]
        moving = moving[changed]
    return energies_of(problem, rotations, maps, scales)


def relaxed_energies(problem: Problem, rng: np.random.Generator) -> dict[str, float]:
    """The relaxation's bound, and the energies of its four starts and of 20 draws after local minimisation."""
    relaxation = solve_pm_sdp(problem, tol=1e-3)
    four = problem.pattern.project(appendix_starts(problem, relaxation))
    drawn = problem.pattern.project(draw_rotations(problem, relaxation, 20, rng))
    return {
        "bound": relaxation.lower_bound,
        "pm_sdp": float(minimise(problem, four).energies[0]),
        "draws": float(minimise(problem, drawn).energies[0]),
    }


def summary(problem: Problem, num: int, rng: np.random.Generator) -> tuple[FloatArray, dict[str, float]]:
    """The exhaustive energies, and one row of figures about them."""
    energies = exhaustive_energies(problem, num)
    row = {"least": float(energies.min()), "median": float(np.median(energies))}
    row["distinct"] = float(len(np.unique(energies.round(9))))
    return energies, {**row, **relaxed_energies(problem, rng)}


def write_csv(file: Path, rows: list[dict[str, float]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--points", type=int, default=50)
    parser.add_argument("--starts", type=int, default=10_000)
    parser.add_argument("--runs", type=int, default=80)
    parser.add_argument("--dims", type=int, nargs="+", default=[3, 5])
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    histograms, runs = [], []
    for sigma in SIGMAS:
        rng = np.random.default_rng(5)
        energies, row = summary(planted(options.points, 3, sigma, rng), options.starts, rng)
        histograms.append((sigma, energies, row))
        print(f"sigma {sigma}: " + ", ".join(f"{k} {v:.4g}" for k, v in row.items()), flush=True)
    for dim in options.dims:
        for run in range(options.runs):
            rng = np.random.default_rng([dim, run])
            _, row = summary(planted(options.points, dim, 0.1, rng), options.starts, rng)
            runs.append({"dim": float(dim), "run": float(run), **row})
        chosen = [r for r in runs if r["dim"] == dim]
        for method in ("pm_sdp", "draws"):
            reached = np.mean([r[method] <= r["least"] * (1 + 1e-6) for r in chosen])
            beaten = np.mean([r[method] <= r["median"] for r in chosen])
            print(f"d = {dim}, {method}: exhaustive optimum {100 * reached:.0f} %, median {100 * beaten:.0f} %")
    write_csv(options.out / "figure5_histograms.csv", [{"sigma": s, **row} for s, _, row in histograms])
    write_csv(options.out / "figure5_runs.csv", runs)
    draw(options.out / "figure5.png", histograms, runs)


def draw(
    file: Path, histograms: list[tuple[float, FloatArray, dict[str, float]]], runs: list[dict[str, float]]
) -> None:
    from matplotlib.figure import Figure

    dims = sorted({r["dim"] for r in runs})
    figure = Figure(figsize=(4 * len(histograms), 7), layout="constrained")
    grid = figure.add_gridspec(2, len(histograms))
    for column, (sigma, energies, row) in enumerate(histograms):
        axes = figure.add_subplot(grid[0, column])
        axes.hist(energies, bins=60, color="0.7")
        axes.axvline(row["pm_sdp"], color="C3", label="PM-SDP, four starts")
        axes.axvline(row["bound"], color="C0", linestyle=":", label="lower bound")
        axes.set(title=f"noise {sigma}", xlabel="energy", ylabel="starts")
        axes.legend(fontsize=7)
    width = len(histograms) // max(len(dims), 1)
    for column, dim in enumerate(dims):
        axes = figure.add_subplot(grid[1, column * width : (column + 1) * width])
        chosen = sorted((r for r in runs if r["dim"] == dim), key=lambda r: r["least"])
        for name, label in (("least", "exhaustive, best"), ("median", "exhaustive, median"), ("pm_sdp", "PM-SDP")):
            axes.plot([r[name] for r in chosen], marker="." if name == "pm_sdp" else None, label=label)
        axes.set(title=f"d = {dim:g}, noise 0.1", xlabel="run, sorted", ylabel="energy")
        axes.legend(fontsize=7)
    figure.savefig(file, dpi=120)


if __name__ == "__main__":
    main()
