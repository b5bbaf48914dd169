# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Running a program to its end with what the operating system says of it."""

import os
import signal
import subprocess
import threading
import time


class Failed(Exception):
    """A program that did not end well."""


def run(command, timeout_s, environment=None):
    """Wall and processor seconds and peak memory of one process with its threads, and its output.

    The kernel counts the memory of this interpreter at the time of the fork as well (some 20 MiB), so
    peaks below that can't be told apart.
    """
    start = time.monotonic()
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
        )
    except OSError as error:
        raise Failed(f"{command[0]}: can't be started: {error.strerror}") from error
    late = threading.Event()

    def stop():
        late.set()
        process.send_signal(signal.SIGKILL)

    timer = threading.Timer(timeout_s, stop)
    timer.start()
    try:
        output = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        process.kill()
        process.wait()
        raise
    finally:
        timer.cancel()
        process.stdout.close()
    wall = time.monotonic() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    text = output.decode(errors="replace")
    if late.is_set():
        raise Failed(f"{command[0]}: stopped after {timeout_s} s")
    if process.returncode != 0:
        raise Failed(f"{' '.join(command)}: exit code {process.returncode}: {text[-2000:]}")
    return {
        "wall_s": round(wall, 4),
        "user_s": round(usage.ru_utime, 4),
        "system_s": round(usage.ru_stime, 4),
        "peak_mib": round(usage.ru_maxrss / 1024, 1),
        "load": round(os.getloadavg()[0], 2),
    }, text
