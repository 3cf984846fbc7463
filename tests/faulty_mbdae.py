"""A solver that misbehaves: passes requests on to the real `mbdae`, but not always its answers.

Which decks suffer, and how, follows from the hash of the deck, so that it does not depend on who asks when. The real
solver's path is in REAL_MBDAE, the misdeeds in MISDEEDS (separated by commas); one pilot deck in ONE_IN (default 3) is
a victim.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path


def deck_of(request: dict[str, object]) -> bytes:
    """The deck of a request, which is a file beside which this program works, or nothing."""
    path = Path(str(request.get("deck", "")))
    return path.read_bytes() if path.is_file() else b""


def misdeed(request: dict[str, object]) -> str:
    """What happens to this request; empty when it is served faithfully."""
    deeds = os.environ["MISDEEDS"].split(",")
    if request.get("deck") != "pilot.mbd":
        return ""
    number = int(hashlib.sha256(deck_of(request)).hexdigest(), 16)
    one_in = int(os.environ.get("ONE_IN", "3"))
    return deeds[number // one_in % len(deeds)] if number % one_in == 0 else ""


def spoil(deed: str, reply: dict[str, object]) -> str:
    """The answer line after the misdeed."""
    output = Path(str(reply["output"]))
    if deed == "other id":
        reply["id"] = 10_000_000
    elif deed == "garbage":
        return "\x00\xff not json {{{"
    elif deed == "list":
        return "[1, 2, 3]"
    elif deed == "no file":
        output.unlink()
    elif deed == "short file":
        output.write_bytes(output.read_bytes()[:5000])
    elif deed == "other deck":
        data = output.read_bytes()
        digest = hashlib.sha256(DECK).hexdigest().encode()
        output.write_bytes(data.replace(digest, b"0" * 64))
    elif deed in ("nan", "sizes"):
        import h5py
        import numpy as np

        with h5py.File(output, "a") as file:
            if deed == "nan":
                file["J_minus"][3, 4] = np.nan
            else:
                J = file["J_plus"][()]
                del file["J_plus"]
                file["J_plus"] = J[:-1, :-1]
    elif deed == "missing key":
        del reply["iterations"]
    return json.dumps(reply)


DECK = b""


def main() -> None:
    """Serve."""
    global DECK
    real = os.environ["REAL_MBDAE"]
    if "--serve" not in sys.argv:
        os.execv(real, [real, *sys.argv[1:]])
    command = [real, "--serve", "--exit-with-parent", str(os.getpid())]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as solver:
        assert solver.stdin is not None and solver.stdout is not None
        for line in sys.stdin.buffer:
            request = json.loads(line)
            deed, DECK = misdeed(request), deck_of(request)
            if deed == "crash":
                os.kill(os.getpid(), signal.SIGSEGV)
            if deed == "exit":
                print("faulty_mbdae: out of ideas", file=sys.stderr, flush=True)
                os._exit(3)
            if deed == "hang":
                time.sleep(3600)
            solver.stdin.write(line)
            solver.stdin.flush()
            answer = solver.stdout.readline()
            if deed:
                answer = spoil(deed, json.loads(answer)).encode("latin-1") + b"\n"
            sys.stdout.buffer.write(answer)
            sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
