# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What all programs that are killed have in common (kills.py): a folder, moments, and what did not hold."""

import os
import random
import shutil
import signal
import sys
import tempfile
import time

from kills_parts import Programs, hidden


class Kind:
    """One program that is killed again and again. What does not hold is told once each time."""

    def __init__(self, bin_folder, seed):
        self.folder = tempfile.mkdtemp(prefix="kills-")
        self.programs = Programs(bin_folder, self.folder)
        self.rng = random.Random(f"{type(self).__name__} {seed}")
        self.whole_s, self.kills, self.runs = 0.3, 0, 0
        self.wrong = {"lost": [], "half": [], "left": [], "stuck": []}
        self.prepare()

    def path(self, name):
        return os.path.join(self.folder, name)

    def tell(self, what, text):
        self.wrong[what].append(text)
        print(f"kills: {type(self).__name__.lower()} {self.kills}: {what}: {text}", file=sys.stderr, flush=True)

    def moment(self):
        """Half of them in the last third, where files change their places."""
        begin = 0 if self.rng.random() < 0.5 else 0.66
        return self.whole_s * (begin + (1.03 - begin) * self.rng.random())

    def killed(self, words, group=False, **how):
        """Whether it was killed before it ended by itself."""
        process = self.programs.start(*words, **how)
        time.sleep(self.moment())
        hit = process.poll() is None
        if group:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
        hit = process.wait() == -signal.SIGKILL and hit
        self.runs += 1
        self.kills += hit
        # So that one in ten ends before it is killed, however busy the machine is.
        self.whole_s *= 1.005 if hit else 0.955
        return hit

    def timed(self, *words):
        begin = time.monotonic()
        self.programs.sound(*words)
        self.whole_s = time.monotonic() - begin

    def left(self, folder=".", beside="no"):
        # Earlier versions of resins are kept.
        found = [n for n in hidden(self.path(folder)) if not (n == ".history" or n.startswith(beside))]
        if found:
            self.tell("left", ", ".join(found))
            for name in found:
                shutil.rmtree(os.path.join(self.path(folder), name), ignore_errors=True)

    def end(self):
        shutil.rmtree(self.folder, ignore_errors=True)
