#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the random tests with the filters NIGHT of tests/CMakeLists.txt.

What asks rounds.hpp for more at night runs at night: a test that calls rounds() or by_night(), by itself or through a
function of its file, is in a suite called ...Night or in a filter NIGHT of its executable. Each pattern of such a filter
names a test. Tests of one executable run in several processes at once, so what they make among temporary files bears
the number of the process or a random name. Prints what is wrong and ends with 1, else 0."""

import fnmatch
import pathlib
import re
import sys

ROOT = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else __file__).resolve()
ROOT = ROOT if ROOT.is_dir() else ROOT.parent.parent
KEYWORDS = {"TIER", "SHARDS", "FILES", "SYSTEM", "SYSTEM_SHARDS", "PEER", "NIGHT", "LIBRARIES", "PROGRAMS", "DEFINITIONS"}


def executables():
    """Name, files and patterns of NIGHT of each call of slicecorr_tests."""
    text = re.sub(r"#.*", "", (ROOT / "tests/CMakeLists.txt").read_text())
    for call in re.findall(r"^\s*slicecorr_tests\(([^)$]+)\)", text, re.MULTILINE):
        words = call.split()
        values, key = {}, None
        for word in words[1:]:
            if word in KEYWORDS:
                key = word
                values[key] = []
            else:
                values[key].append(word)
        yield words[0], values.get("FILES", []), [p for n in values.get("NIGHT", []) for p in n.split(":")]


def tests_of(path):
    """Full name of each test of a file, and whether it asks for more at night."""
    # From one line that begins in the first column to the next: a function, a class or a test each, as the layout is.
    pieces = re.split(r"(?m)\n(?=[A-Za-z].*(?:[({,]|\})$)", path.read_text())
    asks, named = {"rounds", "by_night"}, []
    for piece in pieces:
        test = re.match(r"(TEST|TEST_F|TEST_P)\(\s*(\w+),\s*(\w+)\)", piece)
        head = re.match(r"[^({;]*?(\w+)\s*[({]", piece)
        named.append((test, head.group(1) if head else "", piece))
    more = True
    while more:
        more = False
        for test, name, piece in named:
            if not test and name not in asks and calls(piece, asks):
                asks.add(name)
                more = True
    for test, _, piece in named:
        if test:
            kind, suite, name = test.groups()
            # Tests with parameters have an instance's name before theirs and a parameter's after it.
            yield (f"I/{suite}.{name}/0" if kind == "TEST_P" else f"{suite}.{name}"), calls(piece, asks)


def calls(piece, names):
    return any(re.search(rf"\b{name}\(", piece) for name in names)


wrong = []
asking = 0
for executable, files, patterns in executables():
    tests = [t for name in files for t in tests_of(ROOT / f"tests/{name}_test.cpp")]
    for name, asks in tests:
        asking += asks
        if asks and "Night." not in name and not any(fnmatch.fnmatchcase(name, p) for p in patterns):
            wrong.append(f"{executable}-tests: {name} asks for more at night, and no filter NIGHT takes it")
    for pattern in patterns:
        if not any(fnmatch.fnmatchcase(name, pattern) for name, _ in tests):
            wrong.append(f"{executable}-tests: the filter NIGHT names {pattern}, which is no test")
for path in sorted((ROOT / "tests").glob("*.[ch]pp")):
    text = path.read_text()
    for at in re.finditer(r"(?:TempDir|temp_directory_path)\(\)\s*\)?\s*[/+]", text):
        named = text[at.start():at.start() + 200]
        if "getpid" not in named and "XXXXXX" not in named:
            line = text[:at.start()].count("\n") + 1
            wrong.append(f"tests/{path.name}:{line}: a temporary file of one name for all processes")
if asking < 50:
    wrong.append(f"only {asking} random tests were found: expected 50 or more")
print("\n".join(wrong) if wrong else f"{asking} random tests run at night")
sys.exit(bool(wrong))
