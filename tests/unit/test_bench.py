"""The benchmark measures what it says, and its tables are complete."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
import yaml

from pilotgen.bench import machine, runs, stages
from pilotgen.bench.__main__ import main
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import evaluate
from pilotgen.study.study import read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"


def test_run_counts_the_time_of_children() -> None:
    burn = "import time; end = time.process_time() + 0.3\nwhile time.process_time() < end: pass"
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {burn!r}], check=True)"
    ran = machine.run(["python3", "-c", code])
    assert 0.3 < ran.cpu_s < 2.0
    assert ran.wall_s > 0.3
    with pytest.raises(RuntimeError, match="exit code 3: no luck"):
        machine.run(["sh", "-c", "echo no luck; exit 3"])


def test_variant_changes_what_it_is_told(tmp_path: Path) -> None:
    path = runs.variant(STUDIES / "quick.yaml", tmp_path, "two", limbs=["left", "right"], generations=7)
    study, plain = read_study(path), read_study(STUDIES / "quick.yaml")
    assert study.search.generations == 7
    assert list(study.pilot.limbs) == ["left", "right"]
    assert study.search.population == plain.search.population
    assert study.rotorcraft == plain.rotorcraft


def test_stages_add_up_to_the_whole(mbdae: Path) -> None:
    study = read_study(STUDIES / "quick.yaml")
    pilots = stages.random_pilots(study, 12)
    with EvaluationContext(study) as context:
        first = evaluate(context, pilots[0]).result
        start = time.process_time()
        measured = stages.measure(context, pilots)
        spent_ms = 1e3 * (time.process_time() - start) / len(pilots)
        assert evaluate(context, pilots[0]).result == first  # the stopwatches are gone
    assert set(measured.python_ms) >= set(stages.STAGES) - {"body and cockpit", "torso: its modes"}
    assert len(measured.solver_ms) == 3
    assert all(value > 0.0 for value in measured.solver_ms.values())
    python_ms = sum(measured.python_ms.values())
    assert 0.8 * spent_ms < python_ms <= spent_ms
    assert measured.total_ms == pytest.approx(python_ms + sum(measured.solver_ms.values()))


@pytest.mark.long
def test_tables_are_printed_and_saved(tmp_path: Path, capsys: pytest.CaptureFixture[str], mbdae: Path) -> None:
    text = yaml.safe_load((STUDIES / "puma-mayo.yaml").read_text())
    study = tmp_path / "mayo.yaml"
    study.write_text(yaml.safe_dump(text))
    output = tmp_path / "deep" / "bench.json"
    assert main(["--study", str(study), "--quick", "--output", str(output)]) == 0
    printed = capsys.readouterr().out
    sheet = json.loads(output.read_text())
    assert sheet["machine"]["cores"] >= 1
    assert sheet["search"]["3 generations, 2 workers"][0]["evaluations"] == 60
    for words in ("loop and margins", "cold pilot", "speed-up of the second worker", "each further pilot"):
        assert words in printed
    assert main(["--study", str(tmp_path / "none.yaml")]) == 1
