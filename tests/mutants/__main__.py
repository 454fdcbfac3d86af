"""Puts random faults into the code, one at a time, and runs the tests: ``python -m tests.mutants --random 200``.

Places are drawn over the three packages by ``--seed``. Prints each verdict, the survivors and the killed share; exits
1 where that is below the goal. ``--only TEXT`` takes the faults whose description holds the text.
"""

import argparse
from pathlib import Path

from tests.mutants.draw import by_package, draw
from tests.mutants.equivalent import EQUIVALENT
from tests.mutants.runner import TIME_LIMIT_S, run_mutants

ROOT = Path(__file__).resolve().parents[2]
#: Share of the mutants that tests without data must kill.
GOAL = 0.8


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="")
    parser.add_argument("--random", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--time-limit-s", type=float, default=TIME_LIMIT_S)
    options = parser.parse_args()
    places = draw(ROOT, options.random, options.seed)
    chosen = [mutant for mutant in places if options.only in str(mutant)]
    for mutant in chosen:
        if str(mutant) in EQUIVALENT:
            print(f"equivalent ({EQUIVALENT[str(mutant)]}): {mutant}")
    chosen = [mutant for mutant in chosen if str(mutant) not in EQUIVALENT]
    verdicts = []
    for verdict in run_mutants(chosen, ROOT, time_limit_s=options.time_limit_s):
        verdicts.append(verdict)
        print(f"{verdict.ending:10} {verdict.seconds:5.1f} s  {verdict.mutant}", flush=True)
    num_killed = sum(verdict.ending == "killed" for verdict in verdicts)
    for verdict in verdicts:
        if verdict.ending != "killed":
            print(f"  {verdict.ending}: {verdict.mutant}")
    for package, (killed, tried) in by_package(
        [(one.mutant, one.ending) for one in verdicts]
    ).items():
        print(f"{package}: {killed} of {tried}")
    print(
        f"{num_killed} of {len(verdicts)} mutants killed, {num_killed / max(len(verdicts), 1):.1%}"
    )
    return int(num_killed < GOAL * len(verdicts))


if __name__ == "__main__":
    raise SystemExit(main())
