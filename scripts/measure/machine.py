# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What a measurement was made on, and of what."""

import datetime
import os
import pathlib
import re
import subprocess


def _first_line(command):
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    except OSError:
        return ""
    lines = (answer.stdout or answer.stderr).splitlines()
    return lines[0].strip() if lines else ""


def cache_of(build):
    """The variables of a CMake build folder."""
    path = pathlib.Path(build) / "CMakeCache.txt"
    found = {}
    if path.is_file():
        for line in path.read_text().splitlines():
            match = re.match(r"([A-Za-z_][\w]*):\w+=(.*)", line)
            if match:
                found[match[1]] = match[2]
    return found


def describe(root, build):
    cpu = memory_kib = system = ""
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            cpu = line.split(":", 1)[1].strip()
            break
    for line in pathlib.Path("/proc/meminfo").read_text().splitlines():
        if line.startswith("MemTotal:"):
            memory_kib = int(line.split()[1])
    release = pathlib.Path("/etc/os-release")
    if release.is_file():
        match = re.search(r'^PRETTY_NAME="?([^"\n]*)', release.read_text(), re.MULTILINE)
        system = match[1] if match else ""
    cache = cache_of(build)
    changed = subprocess.run(
        ["git", "-C", root, "status", "--porcelain", "--untracked-files=no"],
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    return {
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": _first_line(["git", "-C", root, "rev-parse", "HEAD"]),
        "changed_since_commit": bool(changed),
        "cpu": cpu,
        "cores": len(os.sched_getaffinity(0)),
        "memory_gib": round(memory_kib / 2**20, 1) if memory_kib else None,
        "system": system,
        "compiler": _first_line([cache.get("CMAKE_CXX_COMPILER", "c++"), "--version"]),
        "build_type": cache.get("CMAKE_BUILD_TYPE", ""),
    }
