#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Configures the project with packages hidden, as on machines that lack them: SOURCE [WORK].

A package that the build needs is named in one line that says how to get it. Without one that only tests need, AUTO
configures all the same, says which is missing and makes no tests; without an extra one tests are there. With what
`scripts/setup --program` installs alone, and with that and GoogleTest, the programs can be built. No find_package()
stands outside of the lists in cmake/SlicecorrDependencies.cmake. Prints what is wrong and ends with 1, else 0."""

import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(sys.argv[1]).resolve()
wrong = []


def packages(name):
    """The words of set(NAME ...) in the list of packages."""
    text = (ROOT / "cmake/SlicecorrDependencies.cmake").read_text()
    return re.search(rf"set\({name} ([^)]*)\)", text)[1].split()


NEEDED = (
    packages("SLICECORR_LINKED_PACKAGES")
    + packages("SLICECORR_BUILD_PACKAGES")
    + packages("SLICECORR_PROGRAM_PACKAGES")
)
# Name of the package to the targets that tests link.
TESTS = {entry.split("=")[0]: entry.split("=")[1:] for entry in packages("SLICECORR_TEST_PACKAGES")}
EXTRA = packages("SLICECORR_TEST_EXTRA_PACKAGES")
# Tools that are no packages of CMake: manual pages, pages of docs/, a cache for the compiler, the Python of tests.
TOOLS = ["HELP2MAN_PROGRAM=", "SLICECORR_DOCS_PYTHON=/bin/false", "CCACHE_PROGRAM="]


class Folder:
    """A build folder that is configured again and again, so that what every case finds alike is looked for once."""

    def __init__(self, path):
        self.path = path
        self.before = {}

    def configure(self, hidden, settings=()):
        """What CMake says, and its exit code."""
        values = {f"CMAKE_DISABLE_FIND_PACKAGE_{name}": "ON" for name in hidden}
        values |= dict(setting.split("=", 1) for setting in settings)
        arguments = [f"-D{key}={value}" for key, value in values.items()]
        # What an earlier case set is taken back.
        arguments += [f"-U{key}" for key in self.before if key not in values]
        self.before = values
        done = subprocess.run(
            ["cmake", "-S", ROOT, "-B", self.path, "-G", "Ninja", *arguments],
            capture_output=True,
            text=True,
        )
        return done.returncode, done.stdout + done.stderr

    def targets(self):
        text = (self.path / "build.ninja").read_text()
        return {name for name in ("library-tests", "slicecorr-program", "printbridge-program") if f"build {name}:" in text}


def check(holds, what, said):
    if not holds:
        wrong.append(f"{what}:\n    " + "\n    ".join(said.strip().splitlines()[-12:]))


def lines(said):
    """CMake wraps what it says; here it is in one line."""
    return re.sub(r"\s+", " ", said)


def without_tests(folder, what, hidden, settings, missing):
    code, said = folder.configure(hidden, ["SLICECORR_TESTS=AUTO", *settings])
    check(code == 0, f"{what}: AUTO does not configure", said)
    told = re.search(r"No tests, which need ([^(]*) \(scripts/setup installs", lines(said))
    check(told and sorted(told[1].split(", ")) == sorted(missing), f"{what}: it does not say that {missing} are missing", said)
    if code == 0:
        there = folder.targets()
        check("library-tests" not in there, f"{what}: there are tests", said)
        check("slicecorr-program" in there and "printbridge-program" in there, f"{what}: programs are missing", said)


def check_calls():
    """Every find_package() is one of the lists' loops, or names a package of the extra ones."""
    for path in [ROOT / "CMakeLists.txt", *ROOT.glob("*/**/CMakeLists.txt"), *ROOT.glob("cmake/*.cmake")]:
        if "consumer" in path.parts or path.is_relative_to(ROOT / "build"):
            continue
        for number, line in enumerate(path.read_text().splitlines(), 1):
            call = re.match(r"\s*find_package\((\S+)", line)
            if call and call[1] not in ("${package}", "${name}", *EXTRA):
                wrong.append(f"{path.relative_to(ROOT)}:{number}: {call[1]} is in no list of cmake/SlicecorrDependencies.cmake")


def main(work):
    check_calls()
    folder = Folder(work)
    code, said = folder.configure([], ["SLICECORR_TESTS=AUTO"])
    check(code == 0 and "library-tests" in folder.targets(), "with all packages there are no tests", said)
    if wrong:
        return

    for name in EXTRA:
        code, said = folder.configure([name], ["SLICECORR_TESTS=AUTO"])
        check(code == 0 and "library-tests" in folder.targets(), f"without {name} there are no tests", said)
        check("scripts/setup installs it" in lines(said), f"without {name} nothing is said", said)
    for name, targets in TESTS.items():
        if name in NEEDED:
            # The package is there, but not all of it.
            part = targets[0].replace("::", "_")
            without_tests(folder, f"without {targets[0]}", [], [f"{part}_INCLUDE_PATH="], [targets[0]])
        else:
            without_tests(folder, f"without {name}", [name], [], [name])
    code, said = folder.configure(["PNG"], ["SLICECORR_TESTS=ON"])
    check(code != 0 and "tests need PNG; scripts/setup" in lines(said), "tests that are asked for: PNG is not named", said)

    # Nothing but what setup --program installs, and a developer's machine that has GoogleTest and Google Benchmark, too.
    only_tests = [name for name in TESTS if name not in NEEDED]
    without_tests(folder, "setup --program", [*only_tests, *EXTRA], [*TOOLS, "X11_Xfixes_INCLUDE_PATH="], [*only_tests, "X11::Xfixes"])
    left = [name for name in only_tests if name != "GTest"]
    without_tests(folder, "setup --program and GoogleTest", [*left, "FFTW"], [*TOOLS, "X11_Xfixes_INCLUDE_PATH="], [*left, "X11::Xfixes"])

    for name in NEEDED:
        code, said = folder.configure([name], ["SLICECORR_TESTS=OFF"])
        check(
            code != 0 and re.search(rf"slicecorr needs [^;]*\b{name}\b[^;]*; scripts/setup --program", lines(said)),
            f"without {name}: it is not named with how to get it",
            said,
        )


if __name__ == "__main__":
    if len(sys.argv) > 2:
        main(pathlib.Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as work:
            main(pathlib.Path(work))
    for line in wrong:
        print(f"front door: {line}")
    if not wrong:
        print(f"front door: {len(NEEDED) + len(TESTS) + len(EXTRA)} packages hidden in turn, each is told")
    sys.exit(1 if wrong else 0)
