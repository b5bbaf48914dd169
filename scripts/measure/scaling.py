# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""How much of a program's work is done by one thread alone, and what follows for many cores."""

import math
import os
import pathlib
import subprocess
import time

CORES = (1, 2, 4, 8, 16, 32, 64)
INTERVAL_S = 0.002


def _threads(pid):
    """Of every thread: whether it wants to run, and how long it has run, in ns."""
    found = {}
    try:
        for task in os.scandir(f"/proc/{pid}/task"):
            try:
                state = pathlib.Path(task.path, "stat").read_text().rpartition(")")[2].split()[0]
                ran = int(pathlib.Path(task.path, "schedstat").read_text().split()[0])
                found[task.name] = (state == "R", ran)
            except (OSError, ValueError, IndexError):
                continue
    except OSError:
        pass
    return found


def sample(command, environment):
    """Processor seconds of a program while one thread alone wanted to run, and while several did.

    Threads that wait for a core count as running, so other work on the machine changes little.
    """
    alone = together = 0.0
    before = {}
    start = time.monotonic()
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment
    )
    try:
        while process.poll() is None:
            now = _threads(process.pid)
            ran = sum(max(0, n - before.get(t, (False, 0))[1]) for t, (_, n) in now.items()) / 1e9
            eager = sum(
                1 for t, (running, n) in now.items() if running or n - before.get(t, (False, 0))[1] > 1e9 * INTERVAL_S / 2
            )
            if eager > 1:
                together += ran
            else:
                alone += ran
            before = now
            time.sleep(INTERVAL_S)
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    if process.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: exit code {process.returncode}")
    return {"alone_s": round(alone, 4), "together_s": round(together, 4), "wall_s": round(time.monotonic() - start, 3)}


def speed(alone_s, together_s, cores, bands):
    """How many times as fast as one core: bands are shared out whole, the rest is done alone."""
    rounds = math.ceil(bands / cores)
    return (alone_s + together_s) / (alone_s + together_s * rounds / bands)


def predict(sampled, bands):
    alone, together = sampled["alone_s"], sampled["together_s"]
    return {
        "serial_share": round(alone / (alone + together), 4),
        "bands": bands,
        "speed": {str(n): round(speed(alone, together, n, bands), 2) for n in CORES},
    }
