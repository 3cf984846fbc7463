"""The same study on a dask cluster: a scheduler and workers in processes of their own, one of which is murdered."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from processes import (
    PATIENCE_S,
    assert_all_gone,
    children,
    command_of,
    dask_scheduler,
    kill,
    recorded,
    run,
    start,
    start_dask_worker,
    wait_until,
)

pytest.importorskip("distributed")

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = yaml.safe_load((STUDIES / "quick.yaml").read_text())
    text["search"].update(population=16, generations=3)
    path = tmp_path_factory.mktemp("study") / "study.yaml"
    path.write_text(yaml.safe_dump(text))
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the scheduler and its workers put their files."""
    return tmp_path_factory.mktemp("dask")


@pytest.fixture(scope="module")
def scheduler(place: Path) -> Iterator[str]:
    """Address of a scheduler."""
    with dask_scheduler(place) as address:
        yield address


def test_cluster_gives_the_same_bytes_even_when_a_worker_is_murdered(
    study: Path, scheduler: str, place: Path, tmp_path: Path
) -> None:
    local = run("search", study, "-o", tmp_path / "local", "--workers", "2", "--no-report", "--quiet")
    assert local.returncode == 0, local.stderr
    workers = [start_dask_worker(scheduler, place) for _ in range(2)]
    directory = tmp_path / "cluster"
    process = start(
        "search", study, "-o", directory, "--no-report", "--quiet",
        "--executor", "dask", "--scheduler", scheduler,
    )  # fmt: skip
    try:
        wait_until(lambda: recorded(directory) >= 18 or process.poll() is not None, "the second generation")
        busy = next(worker for worker in workers if children(worker.pid))
        solvers = [pid for pid in children(busy.pid) if "--serve" in command_of(pid)]
        assert solvers
        kill(busy.pid)
        busy.wait()
        assert_all_gone(solvers)
        out, err = process.communicate(timeout=4 * PATIENCE_S)
    finally:
        kill(process.pid)
        for worker in workers:
            if worker.poll() is None:
                worker.terminate()
            worker.wait()
    assert process.returncode == 0, err
    assert " 0 failed" in out
    assert (directory / "study.h5").read_bytes() == (tmp_path / "local" / "study.h5").read_bytes()


def test_worker_with_another_solver_is_refused(
    study: Path, scheduler: str, place: Path, tmp_path: Path, mbdae: Path
) -> None:
    other = tmp_path / "mbdae"
    other.write_bytes(mbdae.read_bytes() + b"\0")  # runs all the same
    other.chmod(0o755)
    worker = start_dask_worker(scheduler, place)
    try:
        done = run(
            "search", study, "-o", tmp_path / "out", "--no-report", "--quiet",
            "--executor", "dask", "--scheduler", scheduler, PILOTGEN_MBDAE=str(other),
        )  # fmt: skip
    finally:
        worker.terminate()
        worker.wait()
    assert done.returncode == 1
    assert f"the worker on {os.uname().nodename} has another pilotgen" in done.stderr
    assert "Traceback" not in done.stderr


def test_local_cluster_is_started_and_stopped(study: Path, tmp_path: Path) -> None:
    process = start(
        "sample", study, "-n", "24", "-o", tmp_path / "out", "--quiet", "--executor", "dask", "--workers", "2"
    )
    wait_until(lambda: recorded(tmp_path / "out") >= 4 or process.poll() is not None, "some evaluations")
    family = children(process.pid)
    out, err = process.communicate(timeout=4 * PATIENCE_S)
    assert process.returncode == 0, err
    assert "24 pilots" in out
    assert_all_gone(family)
    size = json.loads(run("status", tmp_path / "out", "--json").stdout)["beat"]["worker_memory_bytes"]
    assert 6e7 < size < 5e8, "a worker with numpy and scipy, and its solver"


def test_no_scheduler_is_told(study: Path, tmp_path: Path) -> None:
    """In a process of its own, as dask leaves threads behind; a second is patience enough where nobody is."""
    code = (
        "import sys, pilotgen.runs.dask, pilotgen.cli\n"
        "pilotgen.runs.dask.CONNECT_TIMEOUT_S = 1.0\n"
        "sys.exit(pilotgen.cli.main(sys.argv[1:]))"
    )
    command = ["search", study, "-o", tmp_path / "out", "--executor", "dask", "--scheduler", "tcp://127.0.0.1:9"]
    done = subprocess.run([sys.executable, "-c", code, *command], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "no dask scheduler answers there" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate that signs itself, and its key."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificate, and is not here")
    directory = tmp_path_factory.mktemp("tls")
    cert, key = directory / "cert.pem", directory / "key.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(cert)],
        check=True, capture_output=True,
    )  # fmt: skip
    return cert, key


def test_a_scheduler_with_certificates(certificate: tuple[Path, Path], tmp_path: Path) -> None:
    """Who has no certificate is told; who has one gets the bytes of a local run."""
    cert, key = map(str, certificate)
    tls = ["--tls-ca-file", cert, "--tls-cert", cert, "--tls-key", key]
    mayo = STUDIES / "puma-mayo.yaml"
    with dask_scheduler(tmp_path, "tls://127.0.0.1", tls) as address:
        assert address.startswith("tls://")
        worker = start_dask_worker(address, tmp_path, tls)
        try:
            command = ("sample", mayo, "-n", "6", "--quiet", "--executor", "dask", "--scheduler", address)
            done = run(*command, "-o", tmp_path / "none")
            assert done.returncode == 1 and "Traceback" not in done.stderr
            assert "DASK_DISTRIBUTED__COMM__TLS__CA_FILE" in done.stderr.splitlines()[-1]
            prefix = "DASK_DISTRIBUTED__COMM__TLS__"
            names = {f"{prefix}CA_FILE": cert, f"{prefix}CLIENT__CERT": cert, f"{prefix}CLIENT__KEY": key}
            done = run(*command, "-o", tmp_path / "tls", **names)
            assert done.returncode == 0, done.stderr
            assert "anybody who reaches" not in done.stderr
        finally:
            worker.terminate()
            worker.wait()
    local = run("sample", mayo, "-n", "6", "--quiet", "--workers", "1", "-o", tmp_path / "local")
    assert local.returncode == 0, local.stderr
    assert (tmp_path / "tls" / "study.h5").read_bytes() == (tmp_path / "local" / "study.h5").read_bytes()


def test_a_local_cluster_is_this_machines_and_a_stopped_worker_is_replaced(tmp_path: Path) -> None:
    psutil = pytest.importorskip("psutil")
    directory = tmp_path / "out"
    process = start(
        "sample", STUDIES / "quick.yaml", "-n", "60", "-o", directory, "--quiet", "--executor", "dask",
        "--workers", "1", "--time-limit", "2",
    )  # fmt: skip
    try:
        wait_until(lambda: recorded(directory) >= 3 or process.poll() is not None, "three pilots")
        everybody = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
        listening = [
            connection.laddr.ip
            for one in everybody
            for connection in one.net_connections()
            if connection.status == psutil.CONN_LISTEN
        ]
        assert listening and set(listening) == {"127.0.0.1"}
        worker = next(one for one in everybody[1:] if any("mbdae" in c.name() for c in one.children()))
        worker.suspend()
        out, err = process.communicate(timeout=4 * PATIENCE_S)
    finally:
        kill(process.pid)
    assert process.returncode == 0, err
    assert "60 pilots" in out and "0 failed" in out
