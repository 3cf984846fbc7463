"""`python -m pilotgen.bench`: measure, print tables, save them as JSON.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

from pilotgen.runs.executor import pin_threads

Sheet = dict[str, Any]
# Pilots other than one arm with the study's torso: what they have in their studies (`runs.variant`).
_PILOTS: dict[str, dict[str, Any]] = {
    "one arm, rigid torso": {"limbs": ["left"], "torso": "rigid"},
    "one arm, torso in modes": {"limbs": ["left"], "torso": "modes"},
    "two arms": {"limbs": ["left", "right"]},
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what the command line asks for; returns the exit code."""
    pin_threads()  # before numpy comes in
    args = _parser().parse_args(arguments)
    if not args.study.is_file():
        print(f"pilotgen.bench: {args.study}: no such file; give --study STUDY.yaml", file=sys.stderr)
        return 1
    from pilotgen.bench.machine import describe
    from pilotgen.errors import PilotgenError

    sheet: Sheet = {"study": args.study.name, "runs": args.runs, "machine": describe()}
    print("machine: " + ", ".join(f"{name} {value}" for name, value in sheet["machine"].items()))
    try:
        for name, measure in _parts(args):
            sheet[name] = measure()
    except PilotgenError as error:
        print(f"pilotgen.bench: error: {error}", file=sys.stderr)
        return 1
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(sheet, indent=1) + "\n", encoding="utf-8")
    print(f"\nsaved: {args.output}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m pilotgen.bench", description="Measure where the time goes.")
    parser.add_argument("--study", type=Path, default=Path("docs/studies/puma-bmi.yaml"), help="study file")
    parser.add_argument("--runs", type=int, default=3, help="runs of everything; minimum and median are told")
    parser.add_argument("--pilots", type=int, default=200, help="pilots per run of the stage table")
    parser.add_argument("--quick", action="store_true", help="small numbers: half a minute instead of several")
    parser.add_argument(
        "--quality", action="store_true", help="also the hypervolume against NSGA-II over 11 seeds (minutes)"
    )
    parser.add_argument("--output", type=Path, default=Path("results/bench.json"), help="JSON of everything measured")
    return parser


def _parts(args: argparse.Namespace) -> list[tuple[str, Callable[[], Sheet]]]:
    parts: list[tuple[str, Callable[[], Sheet]]] = [
        ("stages", lambda: _stages(args)),
        ("search", lambda: _search(args)),
        ("people", lambda: _people(args)),
    ]
    if args.quality:
        parts.append(("quality", lambda: _quality(args)))
    return parts


# ---- one process


def _stages(args: argparse.Namespace) -> Sheet:
    from pilotgen.bench import floors, runs, stages
    from pilotgen.context import EvaluationContext
    from pilotgen.runs.task import keep_freed_memory
    from pilotgen.study.study import read_study

    keep_freed_memory()  # as workers do
    count, repeat = (20, 2) if args.quick else (args.pilots, args.runs)
    sheet: Sheet = {}
    with tempfile.TemporaryDirectory(prefix="pilotgen-bench-") as text:
        directory = Path(text)
        arms: dict[str, Path] = {"one arm": args.study}
        multibody = read_study(args.study).pilot.model == "multibody"
        if multibody:
            arms = {
                name: runs.variant(args.study, directory, name.replace(" ", "-"), **pilot)
                for name, pilot in {"one arm": {"limbs": ["left"]}, **_PILOTS}.items()
            }
        for name, path in arms.items():
            study = read_study(path)
            with EvaluationContext(study) as bench:
                pilots = stages.random_pilots(study, count)
                stages.measure(bench, pilots[: min(10, count)])  # caches filled, solver started
                measured = [stages.measure(bench, pilots) for _ in range(repeat)]
                sheet[name] = _stage_table(name, measured)
                if multibody and name == "one arm":
                    shot = stages.one_pilot(bench, pilots[0], directory)
                    assert bench.mbdae is not None
                    result_text = json.dumps(shot.result)
                    sheet["floors"] = floors.measure(shot.unknowns, bench.mbdae, result_text)
                    alone = runs.one_shot(bench.mbdae, shot.deck, 10)
                    start = sheet["floors"]["start of mbdae (--version)"]
                    sheet["mbdae DECK, a process of its own"] = alone
                    sheet["mbdae, the linearisation itself (wall)"] = [1e3 * s for s in shot.solver_seconds]
                    rows = {
                        **sheet["floors"],
                        "mbdae DECK, a process of its own": alone,
                        "mbdae DECK beyond its start": [value - min(start) for value in alone],
                        "mbdae, the linearisation itself (wall)": sheet["mbdae, the linearisation itself (wall)"],
                    }
                    _print_times(f"floors and the solver alone, ms of CPU time ({shot.unknowns} unknowns)", rows)
    return sheet


def _stage_table(name: str, measured: Sequence[Any]) -> Sheet:
    first = measured[0]
    rows = {stage: [m.python_ms[stage] for m in measured] for stage in first.python_ms}
    rows.update({stage: [m.solver_ms[stage] for m in measured] for stage in first.solver_ms})
    rows["sum of this process"] = [sum(m.python_ms.values()) for m in measured]
    rows["sum of the solver"] = [sum(m.solver_ms.values()) for m in measured]
    rows["one pilot"] = [m.total_ms for m in measured]
    _print_times(
        f"stages, ms of CPU time per pilot: {name}, {len(measured)} runs of {first.pilots} pilots, "
        f"{first.failed} failed",
        rows,
    )
    return {"pilots": first.pilots, "failed": first.failed, "ms": rows}


# ---- whole runs


def _search(args: argparse.Namespace) -> Sheet:
    from pilotgen.bench import runs
    from pilotgen.study.study import read_study

    repeat = 1 if args.quick else args.runs
    sheet: Sheet = {}
    with tempfile.TemporaryDirectory(prefix="pilotgen-bench-") as text:
        directory = Path(text)
        study = read_study(args.study)
        search = study.search
        population, generations = (20, 3) if args.quick else (search.population, search.generations)
        small = max(1, generations // 5)
        full = runs.variant(args.study, directory, "full", population=population, generations=generations)
        part = runs.variant(args.study, directory, "part", population=population, generations=small)
        kinds = [
            (f"{generations} generations, 2 workers", full, 2),
            (f"{generations} generations, 1 worker", full, 1),
            (f"{small} generations, 2 workers", part, 2),
        ]
        if study.pilot.model == "multibody":
            size = {"population": population, "generations": small}
            for name, pilot in _PILOTS.items():
                path = runs.variant(args.study, directory, name.replace(" ", "-"), **size, **pilot)
                kinds.append((f"the same, {name}", path, 2))
        sheet.update((name, []) for name, _, _ in kinds)
        for _ in range(repeat):  # in turn: machines change their speed, and these are compared with each other
            for name, path, workers in kinds:
                sheet[name].append(asdict(runs.search(path, workers)))
        cold = [runs.cold_pilot(args.study) for _ in range(max(3, repeat))]
        sheet["cold pilot"] = [{"cpu_s": ran.cpu_s, "wall_s": ran.wall_s} for ran in cold]
    print("\nwhole runs (minimum / median)")
    print(f"  {'':34s} {'evaluations':>11s} {'CPU s':>15s} {'CPU ms/pilot':>15s} {'wall s':>15s}")
    for name, found in sheet.items():
        n = found[0].get("evaluations", 1)
        cpu, wall = [run["cpu_s"] for run in found], [run["wall_s"] for run in found]
        print(f"  {name:34s} {n:11d} {_pair(cpu)} {_pair([1e3 * s / n for s in cpu])} {_pair(wall)}")
    whole, few = sheet[f"{generations} generations, 2 workers"], sheet[f"{small} generations, 2 workers"]
    more = whole[0]["evaluations"] - few[0]["evaluations"]
    if more > 0:
        each = 1e3 * (min(r["cpu_s"] for r in whole) - min(r["cpu_s"] for r in few)) / more
        sheet["each further pilot"] = {"cpu_ms": each}
        print(f"  each further pilot: {each:.2f} ms of CPU time")
    alone = sheet[f"{generations} generations, 1 worker"]
    ratios = [one["wall_s"] / two["wall_s"] for one, two in zip(alone, whole, strict=True)]
    sheet["speed-up of the second worker"] = {"wall": ratios}
    print(f"  speed-up of the second worker: {median(ratios):.2f} (median of {', '.join(f'{r:.2f}' for r in ratios)})")
    return sheet


PEOPLE, BASE, NUMBERS, FEW = 20_000, 2048, 12, 256  # what a whole population and whole indices are


def _people(args: argparse.Namespace) -> Sheet:
    """A small population and small indices, and what whole ones take at the pace from a tiny run to a small one.

    `idle` is by CPU time, spread over two cores.
    """
    from pilotgen.bench import runs

    men, twelve = args.study.parent / "puma-population.yaml", args.study.parent / "puma-twelve.yaml"
    if not (men.is_file() and twelve.is_file()):
        print(f"\npeople and indices are not measured: {men.name} and {twelve.name} are not beside {args.study.name}")
        return {}
    block = NUMBERS + 2  # pilots of a base point
    base = 32 if args.quick else 64
    few, many = (40, 120) if args.quick else (100, 500)
    kinds: dict[str, tuple[int, int, int, Callable[[int], Any]]] = {
        f"{PEOPLE} people": (few, many, PEOPLE, lambda n: runs.people(men, n, 2)),
        f"indices of {NUMBERS} numbers, {BASE} base points": (
            16 * block,
            base * block,
            BASE * block,
            lambda n: runs.decides(twelve, n // block, 2),
        ),
        f"indices of {NUMBERS} numbers, polynomial through {FEW}": (
            FEW // 4,
            FEW,
            FEW,
            lambda n: runs.decides(twelve, n, 2, "--surrogate"),
        ),
    }
    sheet: Sheet = {}
    print("\npeople and indices, 2 workers: a small run, and all of it at that pace")
    print(f"  {'':52s} {'pilots':>8s} {'wall s':>8s} {'ms/pilot':>9s} {'peak MiB':>9s} {'all, min':>9s} {'idle':>7s}")
    for name, (small, large, whole, measure) in kinds.items():
        tiny, ran = measure(small), measure(large)
        each = max(ran.wall_s - tiny.wall_s, 1e-3 * ran.wall_s) / (large - small)
        minutes = (ran.wall_s + each * (whole - large)) / 60.0
        cpu_ms = 1e3 * (ran.cpu_s - tiny.cpu_s) / (large - small)
        idle = 1e-3 * cpu_ms * whole / 2.0 / 60.0  # of two cores that do nothing else
        sheet[name] = {
            "pilots": large,
            "wall_s": ran.wall_s,
            "cpu_ms_per_pilot": cpu_ms,
            "peak_mib": ran.memory_mib,
            "all_min": minutes,
            "all_min_idle": idle,
        }
        print(
            f"  {name:52s} {large:8d} {ran.wall_s:8.1f} {cpu_ms:9.2f} {ran.memory_mib:9.0f} {minutes:9.2f} {idle:7.2f}"
        )
    return sheet


def _quality(args: argparse.Namespace) -> Sheet:
    from pilotgen.bench import runs

    seeds = range(1, 4) if args.quick else range(1, 12)
    sheet: Sheet = {}
    with tempfile.TemporaryDirectory(prefix="pilotgen-bench-") as text:
        directory = Path(text)
        mayo = args.study.parent / "puma-mayo.yaml"
        reduced = runs.variant(args.study, directory, "reduced", population=24, generations=8)
        for name, path in (("Mayo's pilot", mayo), ("multibody, 24 x 8", reduced)):
            print(f"\nhypervolume against NSGA-II: {name}")
            found = sheet[name] = runs.quality(path, seeds)
            print(
                f"  ratio: median {found['ratio_median']:.4f}, smallest {found['ratio_min']:.4f}; "
                f"{found['distinct_pilots']} pilots, {found['cpu_s']:.0f} s"
            )
    return sheet


# ---- printing


def _pair(values: Sequence[float]) -> str:
    return f"{min(values):7.2f} {median(values):7.2f}"


def _print_times(title: str, rows: dict[str, list[float]]) -> None:
    print(f"\n{title}\n  {'':62s} {'min':>7s} {'median':>7s}")
    for name, values in rows.items():
        print(f"  {name:62s} {_pair(values)}")


if __name__ == "__main__":
    sys.exit(main())
