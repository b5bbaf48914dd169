#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Holds docs/threats.md against the tests: each line names a test that tries it, and each test that is named is there.

    threats.py ROOT                    fails where a line names no test, or one that is not there
    threats.py ROOT --bin FOLDER       runs them, too, and prints a line of JSON for each line of the page

Tests are those of gtest, SUITE.NAME, or those of CTest that run a script (system.NAME). Exit code 0: all held; a test that a
computer skips is told, and is no failure.
"""

import argparse
import json
import os
import re
import subprocess
import sys

GTEST = re.compile(r"\b([A-Z][A-Za-z0-9]+)\.([A-Z]\w+)")
SCRIPT = re.compile(r"\b(?:system|night)\.[a-z-]+")


def rows(page):
    """Section, what is told, and names of tests, of each line of each table."""
    section, table = "", False
    with open(page) as file:
        for line in file:
            if line.startswith("## "):
                section = line[3:].strip()
            if not line.startswith("|"):
                table = False
                continue
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if not table:
                if cells[-1] != "test":
                    raise SystemExit(f"threats: {section}: the last column is '{cells[-1]}'; expected test")
                table = True
            elif not set(cells[0]) <= set("-: "):
                yield section, cells, [f"{a}.{b}" for a, b in GTEST.findall(cells[-1])] + SCRIPT.findall(cells[-1])


def known(root):
    """Test -> the file that it stands in."""
    found = {}
    folder = os.path.join(root, "tests")
    for name in sorted(os.listdir(folder)):
        if name.endswith(".cpp"):
            with open(os.path.join(folder, name), errors="replace") as file:
                for suite, test in re.findall(r"TEST(?:_F|_P)?\((\w+),\s*(\w+)\)", file.read()):
                    found[f"{suite}.{test}"] = name
    with open(os.path.join(folder, "CMakeLists.txt")) as file:
        for test in re.findall(r"add_test\(NAME (\S+)", file.read()):
            found[test] = "CMakeLists.txt"
    return found


class Runner:
    def __init__(self, folder):
        self.programs, self.done, self.folder = {}, {}, folder
        for name in sorted(os.listdir(folder)):
            if name.endswith("-tests"):
                listed = subprocess.run([os.path.join(folder, name), "--gtest_list_tests"], capture_output=True, text=True).stdout
                suite = ""
                for line in listed.splitlines():
                    if line and not line.startswith(" "):
                        suite = line.split("#")[0].strip()
                    elif line.strip():
                        # Of those with parameters, "Kinds/Suite.Test/of": all of them are the test.
                        test = suite.split("/")[-1] + line.split("#")[0].strip().split("/")[0]
                        self.programs[test] = os.path.join(folder, name)

    def run(self, test):
        if test not in self.done:
            if SCRIPT.fullmatch(test):
                command = ["ctest", "--test-dir", os.path.dirname(os.path.abspath(self.folder)), "-R", f"^{re.escape(test)}$", "--no-tests=error"]
            elif test in self.programs:
                command = [self.programs[test], f"--gtest_filter={test}:*/{test}/*"]
            else:
                self.done[test] = "not built here"
                return self.done[test]
            ended = subprocess.run(command, capture_output=True, text=True)
            skipped = "[  SKIPPED ]" in ended.stdout or "***Skipped" in ended.stdout
            self.done[test] = "failed" if ended.returncode != 0 else "skipped" if skipped else "passed"
        return self.done[test]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root")
    parser.add_argument("--bin")
    options = parser.parse_args()
    tests, wrong, lines = known(options.root), [], 0
    runner = Runner(options.bin) if options.bin else None
    for section, cells, named in rows(os.path.join(options.root, "docs/threats.md")):
        lines += 1
        if not named:
            wrong.append(f"{section}: no test of: {cells[0][:80]}")
        wrong += [f"{section}: there is no test {t}" for t in named if t not in tests]
        if runner:
            ended = {t: runner.run(t) for t in named if t in tests}
            wrong += [f"{section}: {t} {how}" for t, how in ended.items() if how not in ("passed", "skipped")]
            if ended and set(ended.values()) == {"skipped"}:
                wrong.append(f"{section}: every test was skipped of: {cells[0][:80]}")
            print(json.dumps({"section": section, "line": cells[0][:80], "tests": ended}, ensure_ascii=False), flush=True)
    if lines < 20:
        wrong.append(f"{lines} lines in docs/threats.md")
    for line in wrong:
        print(f"threats: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
