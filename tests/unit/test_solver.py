"""The solver's client against solvers that work, die, hang, lie and babble.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from pilotgen.errors import FileError, SolverError
from pilotgen.solver.client import SolverClient, find_mbdae
from pilotgen.solver.mbdyn import find_mbdyn, run_mbdyn

REPLY = {
    "id": None,
    "status": "ok",
    "exit_code": 0,
    "message": "",
    "diagnostics": [],
    "analysis": "static",
    "iterations": 4,
    "residual_norm": 1e-12,
    "seconds": 0.001,
    "counts": {"unknowns": 12},
    "nodes": [{"name": "hand_l", "label": 6, "position": [1, 2, 3], "orientation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}],
    "datasets": {},
    "output": "",
}


def fake(directory: Path, body: str, name: str = "mbdae") -> Path:
    """Write an executable Python script: `body` sees `request`, `reply` and `answer()` for every request line."""
    script = f"""#!{sys.executable} -S
import json, os, sys, time
def answer(reply):
    sys.stdout.write(json.dumps(reply) + "\\n"); sys.stdout.flush()
for line in sys.stdin:
    request = json.loads(line)
    reply = json.loads({json.dumps(json.dumps(REPLY))})
    reply["id"] = request["id"]
    task = request["task"]
"""
    script += "".join(f"    {text}\n" for text in body.splitlines())
    path = directory / name
    path.write_text(script)
    path.chmod(0o755)
    return path


def is_alive(pid: int) -> bool:
    """True while the process exists and is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until_gone(pid: int, limit_s: float = 5.0) -> bool:
    deadline = time.monotonic() + limit_s
    while is_alive(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    return not is_alive(pid)


def test_request_and_reply(tmp_path: Path) -> None:
    solver = fake(
        tmp_path,
        """reply["output"] = request["output"]; reply["message"] = json.dumps(request)
answer(reply)""",
    )
    with SolverClient(solver) as client:
        reply = client.request("static", deck_text="begin: ü", name="a.mbd", output=tmp_path / "o.h5", c=0.5)
        first = client.pid
        client.request("static", name="b.mbd", output="p")
        assert client.pid == first
    sent = json.loads(reply.message)
    assert sent == {
        "id": 1,
        "task": "static",
        "deck": "a.mbd",
        "text": "begin: ü",
        "output": str(tmp_path / "o.h5"),
        "options": {"c": 0.5},
    }
    assert reply.iterations == 4
    assert reply.counts == {"unknowns": 12}
    assert reply.output == tmp_path / "o.h5"
    np.testing.assert_array_equal(reply.nodes["hand_l"].position, [1, 2, 3])
    np.testing.assert_array_equal(reply.nodes["hand_l"].orientation @ [1, 0, 0], [0, 1, 0])
    assert first is not None and wait_until_gone(first)


def test_a_large_deck_passes_the_pipe(tmp_path: Path) -> None:
    with SolverClient(fake(tmp_path, 'reply["message"] = "x" * len(request["text"])\nanswer(reply)')) as client:
        assert len(client.request("check", deck_text="#" * 3_000_000).message) == 3_000_000


def test_refusal_is_an_error_in_the_solvers_words(tmp_path: Path) -> None:
    solver = fake(
        tmp_path,
        """reply.update(status="deck_error", exit_code=1, message="a.mbd:3:7: error: expected ';'")
reply["diagnostics"] = [{"file": "a.mbd", "line": 3, "column": 7, "severity": "error", "message": "expected ';'"}]
answer(reply)""",
    )
    with SolverClient(solver) as client:
        with pytest.raises(SolverError, match=r"^solver: a\.mbd:3:7: error: expected ';'$") as caught:
            client.request("check", deck_text="")
        assert caught.value.stage == "solver" and not caught.value.died
        reply = client.request("check", deck_text="", check=False)
    assert reply.status == "deck_error"
    assert [str(item) for item in reply.diagnostics] == ["a.mbd:3:7: error: expected ';'"]


def test_death_is_told_with_its_signal_and_the_next_request_gets_a_new_process(tmp_path: Path) -> None:
    solver = fake(
        tmp_path,
        """if task == "die":
    sys.stderr.write("first\\nstack smashed\\n"); sys.stderr.flush()
    os.kill(os.getpid(), 11)
if task == "exit":
    sys.exit(3)
answer(reply)""",
    )
    with SolverClient(solver) as client:
        client.request("check")
        with pytest.raises(
            SolverError, match="mbdae died with signal SIGSEGV on posture.mbd; .*stack smashed"
        ) as caught:
            client.request("die", name="posture.mbd")
        assert caught.value.died
        assert pickle.loads(pickle.dumps(caught.value)).died
        assert client.request("check").status == "ok"
        with pytest.raises(SolverError, match="ended with exit code 3 on a.mbd"):
            client.request("exit", name="a.mbd")
        assert client.request("check").status == "ok"


def test_a_process_killed_between_requests_is_replaced(tmp_path: Path) -> None:
    with SolverClient(fake(tmp_path, "answer(reply)")) as client:
        client.request("check")
        assert client.pid is not None
        os.kill(client.pid, signal.SIGKILL)
        assert wait_until_gone(client.pid)
        assert client.request("check").status == "ok"


def test_a_hanging_solver_is_stopped_in_time(tmp_path: Path) -> None:
    with SolverClient(fake(tmp_path, 'if task == "hang": time.sleep(60)\nanswer(reply)')) as client:
        client.request("check")
        pid = client.pid
        start = time.monotonic()
        with pytest.raises(SolverError, match=r"did not answer on slow\.mbd within 0\.3 s and was stopped") as caught:
            client.request("hang", name="slow.mbd", timeout_s=0.3)
        assert time.monotonic() - start < 30.0  # the solver would sleep for 60
        assert not caught.value.died
        assert pid is not None and wait_until_gone(pid)
        assert client.request("check").status == "ok"


def test_a_solver_that_never_reads_cannot_block_the_client(tmp_path: Path) -> None:
    path = tmp_path / "mbdae"
    path.write_text("#!/bin/sh\nexec sleep 60\n")
    path.chmod(0o755)
    with SolverClient(path) as client, pytest.raises(SolverError, match="did not answer"):
        client.request("check", deck_text="x" * 3_000_000, timeout_s=0.3)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('reply["id"] = 999\nanswer(reply)', "reply to request 999 where 1 was asked"),
        ("answer(reply); answer(reply)", "more than one line"),
        ('sys.stdout.write("Segmentation fault\\n"); sys.stdout.flush()', "not JSON: 'Segmentation fault'"),
        ('sys.stdout.buffer.write(b"\\xff\\x00\\n"); sys.stdout.flush()', "not JSON"),
        ("answer([1, 2])", "not an object"),
        ('reply["status"] = "fine"\nanswer(reply)', "unknown status 'fine'"),
        ('del reply["nodes"]\nanswer(reply)', "KeyError: 'nodes'"),
        ('reply["nodes"] = 3\nanswer(reply)', "missing or wrong value"),
        ('reply["iterations"] = "many"\nanswer(reply)', "missing or wrong value"),
        ('reply["counts"] = []\nanswer(reply)', "missing or wrong value"),
        ('reply["nodes"][0]["position"] = [1, 2]\nanswer(reply)', "pose of node 'hand_l' has the wrong shape"),
        ('reply["nodes"][0]["position"] = [1, 2, None]\nanswer(reply)', "pose of node 'hand_l' is not finite"),
    ],
)
def test_a_solver_that_lies_is_caught(tmp_path: Path, body: str, words: str) -> None:
    # Both lines of the second case must arrive in one read: the fake writes them in one go.
    if words.startswith("more"):
        body = 'text = json.dumps(reply) + "\\n"\nsys.stdout.write(text + text); sys.stdout.flush()'
    with SolverClient(fake(tmp_path, body)) as client:
        with pytest.raises(SolverError, match="protocol error of mbdae on deck.mbd") as caught:
            client.request("check")
        assert words in caught.value.reason
        assert client.pid is None


def test_a_solver_that_cannot_start(tmp_path: Path) -> None:
    path = tmp_path / "mbdae"
    path.write_text("#!/no/such/interpreter\n")
    path.chmod(0o755)
    with SolverClient(path) as client, pytest.raises(FileError, match="cannot start the solver"):
        client.request("check")


def test_a_client_that_crossed_a_fork_leaves_the_parents_process_alone(tmp_path: Path) -> None:
    program = f"""
import os, sys
from pilotgen.solver.client import SolverClient
client = SolverClient({str(fake(tmp_path, "reply['message'] = str(os.getpid())" + chr(10) + "answer(reply)"))!r})
mine = client.request("version").message
child = os.fork()
if child == 0:
    other = client.request("version").message
    client.close()
    os._exit(0 if other != mine else 1)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
assert client.request("version").message == mine
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("end", ["pass", "sys.exit(1)", "raise KeyError", "os.kill(os.getpid(), 9)"])
def test_no_solver_survives_its_client(tmp_path: Path, end: str) -> None:
    program = f"""
import os, sys
from pilotgen.solver.client import SolverClient
client = SolverClient({str(fake(tmp_path, "answer(reply)"))!r})
client.request("version")
print(client.pid, flush=True)
{end}
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert wait_until_gone(int(done.stdout))


def test_a_client_can_be_closed_in_a_signal_handler_that_interrupted_a_wait(tmp_path: Path) -> None:
    client = SolverClient(fake(tmp_path, "answer(reply)"))
    client.request("version")
    pid, running = client.pid, client._running
    assert pid is not None and running is not None
    running.process._waitpid_lock.acquire()  # type: ignore[attr-defined]  # as `poll` does, and never comes back
    start = time.monotonic()
    client.close()
    assert time.monotonic() - start < 30.0  # not for ever
    running.process._waitpid_lock.release()  # type: ignore[attr-defined]
    assert running.process.wait(timeout=5.0) is not None


# ---- finding -----------------------------------------------------------------------------------------------------


def test_find_mbdae_prefers_option_then_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = fake(tmp_path, "pass", "one"), fake(tmp_path, "pass", "two")
    monkeypatch.setenv("PILOTGEN_MBDAE", str(two))
    assert find_mbdae(one) == one
    assert find_mbdae() == two


def test_find_mbdae_does_not_look_on_when_a_named_one_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(FileError, match="'.*/absent' does not exist"):
        find_mbdae(tmp_path / "absent")
    (tmp_path / "plain").write_text("")
    monkeypatch.setenv("PILOTGEN_MBDAE", str(tmp_path / "plain"))
    with pytest.raises(FileError, match="PILOTGEN_MBDAE: '.*/plain' is not an executable file"):
        find_mbdae()
    with pytest.raises(FileError, match="is not an executable file"):
        find_mbdae(tmp_path)


def test_without_any_solver_the_message_says_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PILOTGEN_MBDAE", raising=False)
    monkeypatch.delenv("PILOTGEN_MBDYN", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("pilotgen.solver.program.resources.files", lambda _: tmp_path)
    with pytest.raises(FileError, match=r"'mbdae' is not installed.*make install"):
        find_mbdae()
    with pytest.raises(FileError, match="MBDyn is not installed"):
        find_mbdyn()
    assert fake(tmp_path, "pass") == find_mbdae()


# ---- MBDyn -------------------------------------------------------------------------------------------------------


def fake_mbdyn(directory: Path, body: str) -> Path:
    path = directory / "mbdyn"
    path.write_text(f'#!/bin/sh\n[ "$1" = -f ] && [ "$3" = -o ] || exit 9\ndeck=$2 prefix=$4\n{body}\n')
    path.chmod(0o755)
    return path


def test_run_mbdyn_returns_the_result_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deck = tmp_path / "pilot.mbd"
    deck.write_text("begin: data;\n")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    fake_mbdyn(tmp_path, 'cp "$deck" "${prefix}_00.m"')
    result = run_mbdyn(deck, tmp_path / "work")
    assert result == tmp_path / "work" / "pilot_00.m"
    assert result.read_text() == "begin: data;\n"
    fake_mbdyn(tmp_path, 'touch "$prefix.nc"')
    assert run_mbdyn(deck, tmp_path / "work") == tmp_path / "work" / "pilot.nc"


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (
            "echo 'Reading...'; echo 'parser error at line 3'; echo bye; exit 1",
            "exit code 1 on pilot.mbd: parser error at line 3",
        ),
        (
            "echo 'Initial derivatives calculation 50 does not converge'; echo 'in DataManager'; echo 'of main'; "
            "echo 'An error occurred during the execution of MBDyn; aborting...'; exit 1",
            "exit code 1 on pilot.mbd: Initial derivatives calculation 50 does not converge",
        ),
        ("kill -SEGV $$", "died with signal SIGSEGV on pilot.mbd"),
        ("exec sleep 30", "did not finish pilot.mbd within 0.3 s"),
        ("exit 0", "left neither pilot.nc nor pilot_00.m"),
    ],
)
def test_run_mbdyn_failures(tmp_path: Path, body: str, words: str) -> None:
    deck = tmp_path / "pilot.mbd"
    deck.write_text("")
    (tmp_path / "pilot.nc").write_text("of an earlier run")
    with pytest.raises(SolverError) as caught:
        run_mbdyn(deck, tmp_path, fake_mbdyn(tmp_path, body), timeout_s=0.3)
    assert words in caught.value.reason
