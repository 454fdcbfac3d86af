import numpy as np
import pytest

from pairwise.tight.dual import evaluate_stage, single_map_stage
from pairwise.tight.lift import make_lift
from pairwise.tight.problem import chiralities, lift_problem
from tests.oracles import brute_force
from tests.tight_problems import small_problem


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("form", ["tight", "quaternion"])
def test_any_multipliers_give_a_lower_bound(seed, form):
    _, problem = chiralities(small_problem(seed, max_target=4))[0]
    lift = make_lift(form, problem.dim)
    blocks = lift_problem(problem, lift, problem.allowed)
    rng = np.random.default_rng(seed)
    size = rng.choice([1e-3, 0.1, 1.0])
    target = size * rng.standard_normal((problem.num_target, len(lift.one)))
    source = size * rng.standard_normal((problem.num_source, len(lift.one)))
    source[0] -= target.sum(axis=0) + source.sum(axis=0) - rng.standard_normal() * lift.one
    identity = size * rng.standard_normal((len(blocks.rows), len(lift.identities)))
    stage = evaluate_stage(lift, blocks, problem.num_source, target, source, identity)
    optimum = brute_force(problem)
    assert stage.bound <= optimum.energy
    used = stage.forced[optimum.point_map, np.arange(problem.num_source)]
    assert (used <= optimum.energy).all()


@pytest.mark.parametrize("seed", range(12))
def test_a_single_map_is_bounded_by_its_procrustes_energy(seed):
    _, problem = chiralities(small_problem(seed))[0]
    best = brute_force(problem)
    kept = np.zeros(problem.allowed.shape, bool)
    kept[best.point_map, np.arange(problem.num_source)] = True
    lift = make_lift("quaternion", problem.dim)
    stage = single_map_stage(lift, lift_problem(problem, lift, kept), problem.num_source)
    assert stage.bound <= best.energy + 1e-14
    assert stage.bound == pytest.approx(best.energy, abs=1e-9)


def test_multipliers_whose_sums_miss_the_identity_pay_for_it() -> None:
    _, problem = chiralities(small_problem(3))[0]
    best = brute_force(problem)
    kept = np.zeros(problem.allowed.shape, bool)
    kept[best.point_map, np.arange(problem.num_source)] = True
    lift = make_lift("quaternion", problem.dim)
    blocks = lift_problem(problem, lift, kept)
    exact = single_map_stage(lift, blocks, problem.num_source)
    rng = np.random.default_rng(0)
    for size in (1e-6, 1e-3, 0.1):
        missed = exact.source_multipliers + size * rng.standard_normal(exact.source_multipliers.shape)
        found = evaluate_stage(
            lift, blocks, problem.num_source, exact.target_multipliers, missed, exact.identity_multipliers
        )
        assert found.bound <= best.energy + 1e-14
