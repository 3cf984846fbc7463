"""The solver's command line and serve mode, as a user and a careless program meet them.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from pilotgen.solver.client import SolverClient
from pilotgen.solver.matrices import read_matrices

# A point mass on a weightless string of length 2 m, as a body hinged at the origin; gravity 9.81 m/s^2 along -z.
PENDULUM = """begin: data; problem: initial value; end: data;
begin: initial value;
    initial time: 0.; final time: 0.5; time step: 1.e-2; method: ms, 0.6; tolerance: 1.e-9; max iterations: 20;
    {card}
end: initial value;
begin: control data; structural nodes: 1; rigid bodies: 1; joints: 1; gravity; {model} end: control data;
set: const integer BOB = 1;
begin: nodes;
    structural: BOB, dynamic, {x:.17g}, 0., {z:.17g}, eye, null, null;
end: nodes;
begin: elements;
    body: 1, BOB, 3., null, diag, 1.e-3, 1.e-3, 1.e-3;
    joint: 1, revolute pin, BOB,
        position, {px:.17g}, 0., {pz:.17g}, orientation, 3, 0., 1., 0., 1, 1., 0., 0.,
        position, null, orientation, 3, 0., 1., 0., 1, 1., 0., 0.;
    gravity: uniform, 0., 0., -1., const, 9.81;
end: elements;
"""
EIGEN = "eigenanalysis: 0., parameter, 0.02;"
LENGTH_M = 2.0


def pendulum(card: str = EIGEN, model: str = "", angle_rad: float = 0.0) -> str:
    x, z = LENGTH_M * math.sin(angle_rad), -LENGTH_M * math.cos(angle_rad)
    return PENDULUM.format(card=card, model=model, x=x, z=z, px=-x, pz=-z)


def run(mbdae: Path, *arguments: str | Path, cwd: Path, **keywords: object) -> subprocess.CompletedProcess[str]:
    command = [str(mbdae), *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=60, check=False, **keywords)  # type: ignore[call-overload,no-any-return]


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.mbd"
    path.write_text(pendulum())
    return path


# ---- what is written ---------------------------------------------------------------------------------------------


def test_linearised_pendulum_has_its_frequency(mbdae: Path, deck: Path) -> None:
    done = run(mbdae, deck, "-o", "out", cwd=deck.parent)
    assert done.returncode == 0, done.stderr
    assert "linearise" in done.stdout and "out.h5" in done.stdout
    with h5py.File(deck.parent / "out.h5") as file:
        assert file.attrs["filetype"] == b"pilotgen matrices"
        assert list(file.attrs["version"]) == [2, 0]
        assert file["deck_sha256"][0].decode() == hashlib.sha256(deck.read_bytes()).hexdigest()
        structure = json.loads(file["structure"][0])
        assert structure["analysis"] == "linearise"
        c = file["scalars"][0, 0]
        assert c == 0.01  # parameter / 2
        plus, minus = file["J_plus"][()], file["J_minus"][()]
        names = structure["dofs"]["name"]
    g_ydot, g_y = (plus + minus) / 2, (plus - minus) / (2 * c)
    assert plus.shape == (len(names), len(names))
    assert names[:3] == ["bob.x", "bob.y", "bob.z"]
    # The slowest finite eigenvalue of (lam g_ydot + g_y) v = 0; closed form of the physical pendulum.
    from scipy.linalg import eigvals

    lam = eigvals(-g_y, g_ydot)
    oscillating = lam[np.isfinite(lam) & (np.abs(lam) < 1e3) & (lam.imag > 0.1)]
    expected = math.sqrt(3.0 * 9.81 * LENGTH_M / (3.0 * LENGTH_M**2 + 1e-3))  # m g l / (m l^2 + J), rad/s
    assert oscillating.size == 1
    assert oscillating[0].imag == pytest.approx(expected, rel=1e-9)


def test_motion_of_the_pendulum(mbdae: Path, tmp_path: Path) -> None:
    (tmp_path / "free.mbd").write_text(pendulum(card="", angle_rad=0.01))
    done = run(mbdae, "free.mbd", "--channels", "bob.x,bob.z", "--every", "5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["free.mbd", "free.motion.h5"]
    with h5py.File(tmp_path / "free.motion.h5") as file:
        assert file.attrs["filetype"] == b"pilotgen motion"
        assert file.attrs["integrator"] == b"ida"
        assert [name.decode() for name in file["channels/name"][()]] == ["bob.x", "bob.z"]
        assert [unit.decode() for unit in file["channels/unit"][()]] == ["m", "m"]
        t, data = file["time"][()], file["data"][()]
    assert data.shape == (11, 2)
    np.testing.assert_allclose(t, np.linspace(0.0, 0.5, 11), atol=1e-12)
    omega = math.sqrt(3.0 * 9.81 * LENGTH_M / (3.0 * LENGTH_M**2 + 1e-3))
    # Small-angle solution; its own error is angle^3 / 16 of phase and 1/6 of sine: below 1e-6 of 0.02 m here.
    np.testing.assert_allclose(data[:, 0], LENGTH_M * 0.01 * np.cos(omega * t), atol=2e-6)
    assert run(mbdae, "free.mbd", "--integrator", "ms", "--final-time", "0.1", cwd=tmp_path).returncode == 0


def test_a_deck_with_eigenanalysis_is_integrated_on_request(mbdae: Path, deck: Path) -> None:
    done = run(mbdae, deck, "--integrate", "--final-time", "0.02", "-o", "out", cwd=deck.parent)
    assert done.returncode == 0, done.stderr
    assert not (deck.parent / "out.h5").exists()
    with h5py.File(deck.parent / "out.motion.h5") as file:
        assert file["time"][-1] == pytest.approx(0.02)


def test_a_directory_as_prefix_takes_the_name_of_the_deck(mbdae: Path, deck: Path) -> None:
    (deck.parent / "results").mkdir()
    for prefix in ("results", "results/"):
        done = run(mbdae, deck, "-o", prefix, cwd=deck.parent)
        assert done.returncode == 0, done.stderr
        assert [path.name for path in (deck.parent / "results").iterdir()] == ["pendulum.h5"]
        (deck.parent / "results" / "pendulum.h5").unlink()


def test_coefficient_and_state_are_taken_over(mbdae: Path, deck: Path) -> None:
    assert run(mbdae, deck, "-c", "0.5", "-o", "a", cwd=deck.parent).returncode == 0
    with h5py.File(deck.parent / "a.h5", "r+") as file:
        assert file["scalars"][0, 0] == 0.5
        y = file["vectors"][:, 0]
        y[-1] = 7.25  # a reaction that the deck's own state does not have
        file["vectors"][:, 0] = y
    done = run(mbdae, deck, "--state", "a.h5", "-o", "b", cwd=deck.parent)
    assert done.returncode == 0, done.stderr
    with h5py.File(deck.parent / "b.h5") as file:
        assert file["vectors"][-1, 0] == 7.25


def test_check_counts_and_layout(mbdae: Path, deck: Path) -> None:
    done = run(mbdae, "--check", deck, cwd=deck.parent)
    assert done.returncode == 0
    assert "1 nodes" in done.stdout and "1 bodies" in done.stdout and "1 joints" in done.stdout
    layout = run(mbdae, "--check", "--layout", deck, cwd=deck.parent).stdout
    assert "bob.gz" in layout and "kg m^2/s" in layout
    assert [path.name for path in deck.parent.iterdir()] == ["pendulum.mbd"]


def test_json_is_the_reply_of_the_serve_mode(mbdae: Path, deck: Path) -> None:
    done = run(mbdae, deck, "--json", cwd=deck.parent)
    reply = json.loads(done.stdout)
    assert (reply["id"], reply["status"], reply["exit_code"]) == (None, "ok", 0)
    assert reply["nodes"][0]["name"] == "bob"
    assert reply["nodes"][0]["position"] == [0.0, 0.0, -LENGTH_M]


# ---- what goes wrong ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "no deck given"),
        (["absent.mbd"], "cannot read 'absent.mbd': No such file or directory"),
        (["."], "Is a directory"),
        (["pendulum.mbd", "--bogus"], "--bogus"),
        (["pendulum.mbd", "-c", "-3"], "must be a number greater than zero, not -3"),
        (["pendulum.mbd", "-c", "fast"], "fast"),
        (["pendulum.mbd", "--integrate", "--integrator", "euler"], "euler"),
        (["pendulum.mbd", "--rtol", "1e-3"], "option 'rtol' belongs to a time integration"),
        (["pendulum.mbd", "--tolerance", "1e-3"], "option 'tolerance' belongs to a static equilibrium"),
        (["pendulum.mbd", "--integrate", "-c", "1"], "option 'c' belongs to a linearisation"),
        (["pendulum.mbd", "--layout"], "--check"),
        (["pendulum.mbd", "--state", "pendulum.mbd"], "'pendulum.mbd' is not an HDF5 file"),
        (["pendulum.mbd", "-o", "no/such/place"], "directory 'no/such': No such file or directory"),
        (["pendulum.mbd", "-o", "pendulum.mbd/x"], "directory 'pendulum.mbd': Not a directory"),
        (["pendulum.mbd", "--integrate", "--channels", "bob.q"], "bob.q"),
    ],
)
def test_usage_and_file_errors(mbdae: Path, deck: Path, arguments: list[str], words: str) -> None:
    done = run(mbdae, *arguments, cwd=deck.parent)
    assert done.returncode == 1
    assert words in done.stderr
    assert done.stdout == ""
    assert [path.name for path in deck.parent.iterdir()] == ["pendulum.mbd"]


def test_deck_errors_are_told_with_their_place(mbdae: Path, tmp_path: Path) -> None:
    text = pendulum().replace("body: 1, BOB", "body: 1, BOX")
    (tmp_path / "bad.mbd").write_text(text)
    line = 1 + text[: text.index("BOX")].count("\n")
    done = run(mbdae, "bad.mbd", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith(f"bad.mbd:{line}:")
    assert ": error: " in done.stderr and "BOX" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["bad.mbd"]


def test_no_equilibrium_is_exit_code_2(mbdae: Path, tmp_path: Path) -> None:
    # A free body under gravity has no static equilibrium.
    text = pendulum(card="", model="model: static;")
    start, end = text.index("    joint:"), text.index("    gravity:")
    (tmp_path / "free.mbd").write_text((text[:start] + text[end:]).replace("joints: 1;", ""))
    done = run(mbdae, "free.mbd", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "free.mbd" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["free.mbd"]


TOO_LARGE, ROOT = "mult, const, 1e200, const, 1e200", 'string, "sqrt(-Time)"'


@pytest.mark.parametrize("place", ["force", "gravity", "joint"])
@pytest.mark.parametrize(
    ("analysis", "drive"),
    [("static", TOO_LARGE), ("static", ROOT), ("eigen", TOO_LARGE), ("ida", TOO_LARGE), ("ida", ROOT),
     ("ms", TOO_LARGE), ("ms", ROOT)],
)  # fmt: skip
def test_what_has_no_finite_value_is_told_in_words(
    mbdae: Path, tmp_path: Path, analysis: str, drive: str, place: str
) -> None:
    text = pendulum(EIGEN if analysis == "eigen" else "", "model: static;" if analysis == "static" else "")
    if place == "force":
        text = text.replace("joints: 1;", "joints: 1; forces: 1;").replace(
            "    gravity:", f"    force: 1, absolute, BOB, position, null, 0., 0., 1., {drive};\n    gravity:"
        )
    elif place == "gravity":
        text = text.replace("const, 9.81", drive)
    else:
        pin = text.index("joint: 1, revolute pin")
        total = (
            "joint: 1, total pin joint, BOB, position, null, position, 0., 0., -2., position constraint, "
            f"active, active, active, component, {drive}, const, 0., const, 0.;\n"
        )
        text = text[:pin] + total + text[text.index("    gravity:") :]
    (tmp_path / "a.mbd").write_text(text)
    done = run(mbdae, "a.mbd", *(["--integrator", "ms"] if analysis == "ms" else []), cwd=tmp_path)
    assert done.returncode in (1, 2), done.stdout
    told = done.stderr.lower()
    assert "finite value" in told and "look for a drive" in told, told
    assert not re.search(r"\b-?(nan|inf)\b|off by 0 |residuals 0\b", told), told


def test_a_full_disk_is_told(mbdae: Path, deck: Path) -> None:
    def no_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # whatever the shell has: mbdae does not die of it
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))

    done = run(mbdae, deck, "-o", "out", cwd=deck.parent, preexec_fn=no_room)
    assert done.returncode == 1
    assert "cannot write 'out.h5': File too large" in done.stderr
    assert [path.name for path in deck.parent.iterdir()] == [deck.name]
    with open("/dev/full", "w") as full:
        done = subprocess.run([mbdae, "--check", deck], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1 and "No space left" in done.stderr


# ---- serve mode --------------------------------------------------------------------------------------------------


def serve(mbdae: Path, data: bytes) -> list[dict[str, object]]:
    done = subprocess.run([mbdae, "--serve"], input=data, capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_every_line_gets_one_reply_whatever_it_is(mbdae: Path, tmp_path: Path) -> None:
    good = json.dumps({"id": 1, "task": "linearise", "text": pendulum(), "output": str(tmp_path / "o.h5")})
    lines: list[tuple[bytes, str]] = [
        (good.encode(), "ok"),
        (b"", "bad_request"),
        (b"{", "bad_request"),
        (b"\xff\xfe\x00\x01", "bad_request"),
        (b"[]", "bad_request"),
        (b"null", "bad_request"),
        (b'"task"', "bad_request"),
        (b"{}", "bad_request"),
        (b'{"task": 3, "text": ""}', "bad_request"),
        (b'{"task": "fly", "text": ""}', "bad_request"),
        (b'{"task": "check"}', "bad_request"),
        (b'{"task": "check", "text": 5}', "bad_request"),
        (b'{"task": "check", "text": "", "colour": "red"}', "bad_request"),
        (b'{"task": "check", "text": "", "options": []}', "bad_request"),
        (b'{"task": "check", "text": "", "options": {"speed": 1}}', "bad_request"),
        (b'{"task": "linearise", "text": "", "options": {"c": "1"}}', "bad_request"),
        (b'{"task": "linearise", "text": "", "options": {"c": 1e999}}', "bad_request"),
        (b'{"task": "linearise", "text": "", "options": {"c": -1}}', "bad_request"),
        (b'{"task": "integrate", "text": "", "options": {"every": 1.5}}', "bad_request"),
        (b'{"task": "check", "text": "", "options": {"nodes": 1}}', "bad_request"),
        (b'{"task": "check", "text": "", "options": {"tangents": 1}}', "bad_request"),
        (b'{"task": "check", "text": "", "options": {"samples": 1}}', "bad_request"),
        (json.dumps({"task": "residuals", "text": pendulum()}).encode(), "bad_request"),
        (b'{"task": "check", "text": "", "options": {"harmonics": 0}}', "bad_request"),
        (json.dumps({"task": "check", "text": pendulum(), "options": {"instants": 64}}).encode(), "bad_request"),
        (json.dumps({"task": "check", "text": pendulum(), "options": {"samples": "x"}}).encode(), "bad_request"),
        (json.dumps({"task": "linearise", "text": pendulum(), "options": {"tangents": True}}).encode(), "bad_request"),
        (json.dumps({"task": "residuals", "text": pendulum(), "options": {"samples": "/no/x"}}).encode(), "io_error"),
        (b'{"task": "check", "text": ""}', "deck_error"),
        (b'{"task": "check", "text": "begin: \\u0000 \\ud83d\\ude00 \\\\"}', "deck_error"),
        (b'{"task": "check", "deck": "/no/such/deck.mbd"}', "io_error"),
        (json.dumps({"task": "static", "text": pendulum()}).encode(), "deck_error"),
        (json.dumps({"task": "check", "text": pendulum(), "options": {"c": 1}}).encode(), "bad_request"),
        (json.dumps({"task": "linearise", "text": pendulum(), "output": "/no/o.h5"}).encode(), "io_error"),
        (b'{"id":' + b"[" * 50000 + b"]" * 50000 + b"}", "bad_request"),
        (b'{"id": {"a": [1, "b"]}, "task": "version"}', "ok"),
        (good.encode(), "ok"),
    ]
    replies = serve(mbdae, b"\n".join(line for line, _ in lines))
    assert [reply["status"] for reply in replies] == [status for _, status in lines]
    assert [reply["exit_code"] for reply in replies] == [0 if status == "ok" else 1 for _, status in lines]
    assert all(reply["message"] for reply in replies if reply["status"] != "ok")
    assert replies[0]["id"] == 1
    assert replies[-2]["id"] == {"a": [1, "b"]}
    assert str(replies[-2]["message"]).startswith("mbdae ")


def test_residuals_along_samples_of_a_file(mbdae: Path, tmp_path: Path) -> None:
    samples, output, matrices = (str(tmp_path / name) for name in ("s.bin", "r.bin", "m.h5"))

    def asked(text: str, numbers: np.ndarray, **options: object) -> dict[str, object]:
        numbers.tofile(samples)
        task = {"task": "residuals", "text": text, "output": output, "options": {"samples": samples, **options}}
        first = {"task": "linearise", "text": text, "output": matrices}
        replies = serve(mbdae, b"\n".join(json.dumps(one).encode() for one in (first, task, task)))
        assert replies[1] | {"seconds": 0.0} == replies[2] | {"seconds": 0.0}  # read, then kept
        return replies[1]

    linear = None
    for text in (pendulum(), pendulum().replace("9.81", "9.0")):
        reply = asked(text, np.zeros(2), tangents=True)
        assert reply["status"] == "bad_request" and "'" + samples in str(reply["message"])
        n = int(str(reply["message"]).split("rows of 2 x ")[1].split(",")[0])
        reply = asked(text, np.zeros((3, 2 * n)), tangents=True)
        assert reply["status"] == "ok", reply
        assert reply["analysis"] == "residuals" and reply["counts"] == {"unknowns": n, "samples": 3}
        linear = read_matrices(Path(matrices))
        numbers = np.fromfile(output)
        assert np.abs(numbers[: 3 * n]).max() < 1e-12
        g_y, g_ydot = numbers[3 * n :].reshape(2, n, n)
        assert np.abs(g_ydot + linear.c * g_y - linear.J_plus).max() < 1e-12
        assert np.abs(g_ydot - linear.c * g_y - linear.J_minus).max() < 1e-12
        asked(text, np.zeros((1, 2 * n)))
        assert len(np.fromfile(output)) == n
    turning = np.zeros((2, n, 3))
    turning[:, :, 1:] = 1e-3 * np.random.default_rng(2).standard_normal((2, n, 2))
    phase = 2.0 * np.pi * np.arange(8) / 8
    in_time = turning @ np.stack((np.ones(8), np.cos(phase), -np.sin(phase)))
    asked(text, np.concatenate(list(in_time)).T, tangents=True, tangents_every=2)
    along = np.fromfile(output)
    reply = asked(text, turning, tangents=True, harmonics=1, instants=8, tangents_every=2)
    numbers, left = np.fromfile(output), along[: 8 * n].reshape(8, n)
    assert reply["counts"] == {"unknowns": n, "samples": 8}
    assert np.allclose(numbers[3 * n :], along[8 * n :], rtol=1e-12, atol=1e-12)
    found = numbers[: 3 * n].reshape(n, 3)
    assert np.allclose(found[:, 0], left.mean(axis=0), atol=1e-13)
    assert np.allclose(found[:, 1] + 1j * found[:, 2], 0.25 * np.exp(-1j * phase) @ left, atol=1e-13)
    for options, wanted in (
        ({"harmonics": 2, "instants": 8}, f"expected 2 x {n} x 5"),
        ({"harmonics": 1, "instants": 2}, "2 instants cannot tell 1 harmonics; give 3 or more"),
        ({"harmonics": 1}, "option 'harmonics' wants 'instants' too"),
        ({"instants": 8}, "option 'instants' wants 'harmonics' too"),
        ({"tangents_every": 2}, "option 'tangents_every' wants 'tangents' too"),
    ):
        reply = asked(text, turning, **options)
        assert reply["status"] == "bad_request" and wanted in str(reply["message"])
    moving = np.zeros((2, 2 * n))
    moving[1, n + 1] = np.nan
    message = str(asked(text, moving)["message"])
    assert "no finite rate in sample 2 of 2" in message and linear is not None and linear.dof_names[1] in message
    Path(samples).write_bytes(b"123")
    task = {"task": "residuals", "text": text, "options": {"samples": samples}}
    assert "3 bytes" in str(serve(mbdae, json.dumps(task).encode())[0]["message"])


def test_residuals_of_a_deck_whose_files_change(mbdae: Path, tmp_path: Path) -> None:
    inside, samples, output = tmp_path / "inside.mbd", tmp_path / "s.bin", tmp_path / "r.bin"
    (tmp_path / "deck.mbd").write_text('include: "inside.mbd";\n')
    inside.write_text(pendulum())
    np.zeros(1).tofile(samples)
    with SolverClient(str(mbdae)) as client:

        def left(check: bool = True) -> str:
            reply = client.request(
                "residuals", name=tmp_path / "deck.mbd", output=output, samples=str(samples), check=check
            )
            return "" if reply.status == "ok" else reply.message

        n = int(left(check=False).split("rows of 2 x ")[1].split(",")[0])
        motion = np.zeros(2 * n)
        motion[3:6] = 0.05, 0.1, 0.15  # turned, about a pin that is elsewhere in another text
        motion.tofile(samples)
        found = []
        for text in (pendulum(), pendulum(), pendulum(angle_rad=0.3), pendulum()):
            inside.write_text(text)
            assert left() == ""
            found.append(np.fromfile(output))
        assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[3])
        assert np.abs(found[2] - found[0]).max() > 1e-3
        inside.unlink()
        assert "cannot include" in left(check=False)


def test_a_line_too_long_is_refused_and_the_next_one_served(mbdae: Path) -> None:
    replies = serve(mbdae, b"x" * (65 << 20) + b'\n{"id": 2, "task": "version"}\n')
    assert [reply["status"] for reply in replies] == ["bad_request", "ok"]


def test_nobody_reads_the_replies(mbdae: Path) -> None:
    process = subprocess.Popen(
        [mbdae, "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdin and process.stdout and process.stderr
    process.stdout.close()
    process.stdin.write(b'{"task": "version"}\n')
    process.stdin.flush()
    assert process.wait(timeout=10) == 1
    assert b"nobody reads the replies" in process.stderr.read()
    process.stdin.close()
    process.stderr.close()


def test_the_solver_ends_with_its_parent(mbdae: Path) -> None:
    # The middle process dies at once; its solver's standard input stays open here.
    read_end, write_end = os.pipe()
    script = f"""
import os, subprocess, time
command = [{str(mbdae)!r}, "--serve", "--exit-with-parent", str(os.getpid())]
print(subprocess.Popen(command, stdin={read_end}).pid, flush=True)
time.sleep(60)
"""
    command = [sys.executable, "-c", script]
    middle = subprocess.Popen(command, stdout=subprocess.PIPE, pass_fds=[read_end], text=True)
    try:
        assert middle.stdout is not None
        pid = int(middle.stdout.readline())
        time.sleep(0.1)
        assert _runs(pid)
        middle.send_signal(signal.SIGKILL)
        middle.wait()
        deadline = time.monotonic() + 5.0
        while _runs(pid) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not _runs(pid)
    finally:
        middle.kill()
        middle.stdout.close()  # type: ignore[union-attr]
        os.close(read_end)
        os.close(write_end)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_client_and_solver_speak_the_same_protocol(solver: SolverClient, tmp_path: Path) -> None:
    output = tmp_path / "m.h5"
    reply = solver.request("linearise", deck_text=pendulum(angle_rad=0.3), name="p.mbd", output=output, c=0.25)
    assert reply.output == output
    assert reply.analysis == "linearise"
    np.testing.assert_allclose(
        reply.nodes["bob"].position, [LENGTH_M * math.sin(0.3), 0.0, -LENGTH_M * math.cos(0.3)], atol=1e-15
    )
    np.testing.assert_array_equal(reply.nodes["bob"].orientation, np.eye(3))
    with h5py.File(output) as file:
        assert file["scalars"][0, 0] == 0.25
    assert solver.request("linearise", deck_text=pendulum(angle_rad=0.3), nodes=False).nodes == {}
    bad = solver.request("check", deck_text="begin: data\n", name="bad.mbd", check=False)
    assert bad.status == "deck_error" and bad.diagnostics[0].file == "bad.mbd"
