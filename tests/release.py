#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Holds scripts/release against a copy of what it reads: it holds for the newest version of the changelog, and finds
each single contradiction. Usage: release.py ROOT. Prints what is wrong and ends with 1, else 0.

What stands under Unreleased is left out of the copy: it is not wrong between two releases."""

import concurrent.futures
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else __file__).resolve()
ROOT = ROOT if ROOT.is_dir() else ROOT.parent.parent
FILES = ["scripts/release", "CMakeLists.txt", "CHANGELOG.md", "CITATION.cff", "README.md"]
# A hook of git that runs the tests says where its checkout is; the copies are none of it.
ENVIRONMENT = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
wrong = []
tried = 0


def copy(folder, pages):
    places = ("pyproject.toml", "libslicecorr/c_api/python/pyproject.toml")
    python = [place for place in places if (ROOT / place).exists()]
    for name in FILES + pages + python:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    change(folder, "CHANGELOG.md", r"(?ms)^## Unreleased\n.*?(?=^## )", "## Unreleased\n\n")


def change(folder, name, pattern, replacement):
    """Replaces the one place of a file that the pattern finds."""
    text, found = re.subn(pattern, replacement, (folder / name).read_text(), count=1)
    if not found:
        wrong.append(f"{name} has nothing like {pattern}")
    (folder / name).write_text(text)


def write(folder, name, text=""):
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)


def run(folder, *arguments):
    command = [folder / "scripts/release", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=ENVIRONMENT, timeout=60)


def expect(what, folder, arguments, code, nots=()):
    """Exit code, and a line NOT that begins so for each of `nots`, and no other."""
    global tried
    tried += 1
    result = run(folder, *arguments)
    lines = result.stdout.splitlines()
    found = [line[5:] for line in lines if line.startswith("NOT  ")]
    if result.returncode != code:
        wrong.append(f"{what}: exit code {result.returncode}, expected {code}: {result.stdout}{result.stderr}")
    if len(found) != len(nots) or not all(any(line.startswith(n) for line in found) for n in nots):
        wrong.append(f"{what}: found {found}, expected {list(nots)}")
    if code != 2 and not all(re.match(r"(ok   |NOT  )\S", line) for line in lines):
        wrong.append(f"{what}: lines are not ok or NOT: {lines}")


def contradictions(version, major):
    """What is made wrong: name, change of the folder, options, and how the lines begin that tell it."""
    other = f"{major + 7}.1.0"
    exactly = re.escape(version)

    def edit(name, pattern, replacement):
        return lambda folder: change(folder, name, pattern, replacement)

    def cmake(replacement):
        return edit("CMakeLists.txt", rf"slicecorr VERSION {exactly}", replacement)

    def heading(replacement):
        return edit("CHANGELOG.md", rf"(?m)^## {exactly} - .*$", replacement)

    def sections(*names):
        text = "".join(f"\n### {name}\n\n- Something.\n" for name in names)
        return edit("CHANGELOG.md", rf"(?s)(## {exactly} - [^\n]*\n).*?(?=\n## |\Z)", rf"\g<1>{text}")

    def page(name, line):
        return edit(name, r"\Z", f"\n    {line}\n")

    def there(*names, text=""):
        return lambda folder: [write(folder, name, text) for name in names]

    def project(text):
        return there("python/pyproject.toml", text=f'[build-system]\nversion = "{other}"\n\n[project]\n{text}\n')

    no_newest = ["CHANGELOG.md: '## ", "CITATION.cff: date"]
    return [
        ("version in CMake", cmake(f"slicecorr VERSION {other}"), [], ["CMakeLists.txt:"]),
        ("no version in CMake", cmake("slicecorr"), [], ["CMakeLists.txt:"]),
        ("version in the changelog", heading(f"## {other} - 2026-01-31"), [],
         [*no_newest, f"CHANGELOG.md: {version} has no sections"]),
        ("a newer version in the changelog", heading(rf"## {other} - 2026-01-31\n\n\g<0>"), [], no_newest),
        ("no date", heading(f"## {version}"), [], no_newest),
        ("a day that is not there", heading(f"## {version} - 2026-02-30"), [], no_newest),
        ("another day", heading(f"## {version} - 2001-02-03"), [], ["CITATION.cff: date"]),
        ("something under Unreleased", edit("CHANGELOG.md", "## Unreleased\n", "## Unreleased\n\n- New.\n"), [],
         ["CHANGELOG.md: Unreleased"]),
        ("no Unreleased", edit("CHANGELOG.md", "## Unreleased\n", ""), [], [f"CHANGELOG.md: '## {version}"]),
        ("unknown section", sections("Breaks", "Improved"), [], ["CHANGELOG.md: section 'Improved', expected"]),
        ("section twice", sections("Added", "Added"), [], ["CHANGELOG.md: section 'Added' stands twice"]),
        ("no sections", sections(), [], [f"CHANGELOG.md: {version} has no sections"]),
        ("breaks late", sections("Added", "Breaks"), [], ["CHANGELOG.md: section 'Breaks' stands after"]),
        ("version of the citation", edit("CITATION.cff", rf"(?m)^version: {exactly}$", f"version: {other}"), [],
         ["CITATION.cff: version"]),
        ("date of the citation", edit("CITATION.cff", r"(?m)^date-released: .*$", "date-released: 2001-02-03"), [],
         ["CITATION.cff: date"]),
        ("no citation", lambda folder: (folder / "CITATION.cff").unlink(), [], ["CITATION.cff: is not there"]),
        ("a page names another package", page("docs/farm.md", f"apt install ./slicecorr_{other}-1_amd64.deb"), [],
         ["README.md, docs/: other"]),
        ("a page names another wheel", page("docs/python.md", f"pip install slicecorr-{other}-py3-none-any.whl"), [],
         ["README.md, docs/: other"]),
        ("README names another program", page("README.md", f"slicecorr {other}"), [], ["README.md, docs/: other"]),
        ("a package of another version", there(f"build/packages/libslicecorr0_{other}-1_amd64.deb"), [],
         ["build/packages/: not of"]),
        ("a wheel of another version", there(f"build/packages/slicecorr-{other}-py3-none-any.whl"), [],
         ["build/packages/: not of"]),
        ("a package without a version", there("build/packages/slicecorr.deb"), [], ["build/packages/: not of"]),
        ("no packages", there(), ["--packages"], ["build/packages/: no packages"]),
        ("another version in pyproject", project(f'version = "{other}"'), [], ["python/pyproject.toml:"]),
        ("no version in pyproject", project('dynamic = ["readme"]'), [], ["python/pyproject.toml:"]),
        # All of these hold.
        ("all sections", sections("Breaks", "Added", "Changed", "Fixed", "Removed", "Known limits"), [], []),
        ("version in pyproject", project(f'version = "{version}"'), [], []),
        ("dynamic version in pyproject", project('dynamic = [\n  "readme",\n  "version",\n]'), [], []),
        ("a page names this package", page("docs/farm.md", f"apt install ./slicecorr_{version}-1_amd64.deb"), [], []),
        ("packages", there(f"build/packages/slicecorr-doc_{version}-1_all.deb",
                           f"build/packages/slicecorr-{version}-py3-none-any.whl", "build/packages/SHA256SUMS"), ["--packages"], []),
    ]


def check_git(folder, version):
    def git(*arguments):
        who = ["-c", "user.name=t", "-c", "user.email=t@localhost"]
        subprocess.run(["git", *who, *arguments], cwd=folder, check=True, capture_output=True, env=ENVIRONMENT)

    expect("no checkout", folder, [version], 1, ["git: this is no git checkout"])
    git("init", "--quiet", ".")
    git("add", ".")
    git("commit", "--quiet", "--message", "all")
    expect("a clean checkout", folder, [version], 0)
    write(folder, "new")
    expect("a new file", folder, [version], 1, ["git: 1 files are changed or new, the first is new"])
    (folder / "new").unlink()
    git("tag", f"v{version}")
    expect("a tag", folder, [version], 1, [f"git: the tag v{version}"])


def main():
    newest = re.search(r"(?m)^## (([0-9]+)\.[0-9]+\.[0-9]+)\b", (ROOT / "CHANGELOG.md").read_text())
    if not newest:
        print("release: the changelog has no version")
        return 1
    version, major = newest.group(1), int(newest.group(2))
    with tempfile.TemporaryDirectory(prefix="slicecorr-release-") as place:
        tree = pathlib.Path(place) / "tree"
        copy(tree, [str(page.relative_to(ROOT)) for page in sorted((ROOT / "docs").rglob("*.md"))])
        expect("the tree", tree, [version, "--no-git"], 0)
        sound = pathlib.Path(place) / "sound"
        copy(sound, ["docs/farm.md", "docs/python.md"])
        for arguments in ([], ["1.2"], ["1.2.3", "1.2.4"], ["--nothing"], ["01.2.3"]):
            expect(f"arguments {arguments}", sound, arguments, 2)
        if "Usage:" not in run(sound, "--help").stdout:
            wrong.append("--help has no usage")

        def try_one(case):
            n, (what, spoil, options, nots) = case
            folder = pathlib.Path(place) / str(n)
            shutil.copytree(sound, folder)
            spoil(folder)
            expect(what, folder, [version, "--no-git", *options], 1 if nots else 0, nots)

        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            list(pool.map(try_one, enumerate(contradictions(version, major))))
        if shutil.which("git"):
            check_git(sound, version)
    for line in wrong:
        print(line)
    print(f"{len(wrong)} wrong" if wrong else f"release: {tried} runs for {version} said what they should")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
