# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A setting more, in a copy of the sources, by docs/howto/setting.md: a row and the two members that it names. All that
has settings must have it then, without another line.

    new_setting.py FOLDER_OF_SOURCES [FOLDER_TO_BUILD_IN]
"""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import urllib.request
import zipfile

ROW = """      {.name = "test_tilt_deg",
       .group = kHowItIsCorrected,
       .chosen = &C::test_tilt_deg,
       .text = "Says nothing but that {omega_max} is not all",
       .range = up_to(9),
       .corrects = true,
       .process = &Process::test_tilt_deg,
       .block = BlockPart::correction,
       .changed_only = true},
"""
ADDED = {
    "libslicecorr/include/slicecorr/settings.hpp": ("  double gap_shortfall = 0;\n", "  double test_tilt_deg = 0;\n"),
    "libslicecorr/include/slicecorr/process.hpp": ("  double omega_max = kNoCap;\n", "  double test_tilt_deg = 0;\n"),
    "libslicecorr/process/settings.cpp": ('      {.name = "one_slice_gaps",\n', ROW),
}
TARGETS = ["slicecorr-program", "slicecorr-post-program", "slicefarm-program", "slicecorr-c"]

faults = []


def expect(what, true, seen=""):
    if not true:
        faults.append(f"{what}: {seen}" if seen else what)


def copy(source, to):
    """The sources as they stand, and not what was built of them."""
    for top in ("CMakeLists.txt", "cmake", "libslicecorr", "slicer-plugin", "farm", "firmware-bridge", "resins", "tests",
                "scripts", "docs", "README.md", "CHANGELOG.md", "CITATION.cff", "LICENSES"):
        if (source / top).is_dir():
            shutil.copytree(source / top, to / top, symlinks=True, dirs_exist_ok=True)
        elif (source / top).exists():
            shutil.copy2(source / top, to / top)


def main():
    source = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else scratch).resolve()
        tree, build = work / "tree", work / "build"
        tree.mkdir(parents=True)
        copy(source, tree)
        for name, (before, more) in ADDED.items():
            text = (tree / name).read_text()
            assert text.count(before) == 1, f"{name}: '{before}' stands {text.count(before)} times"
            (tree / name).write_text(text.replace(before, more + before))
        subprocess.run(["cmake", "-S", tree, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DSLICECORR_TESTS=OFF"],
                       check=True, stdout=subprocess.DEVNULL)
        subprocess.run(["cmake", "--build", build, "--target", *TARGETS], check=True, stdout=subprocess.DEVNULL)
        look(tree, build / "bin", work)
    for f in faults:
        print(f)
    print(f"new_setting: {len(faults)} faults")
    return 1 if faults else 0


def block_of(stack):
    with zipfile.ZipFile(stack) as archive:
        return archive.read("config.json").decode()


def look(tree, programs, folder):
    def run(program, *arguments, code=0):
        r = subprocess.run([programs / program, *map(str, arguments)], cwd=folder, capture_output=True, text=True)
        expect(f"{program} {' '.join(map(str, arguments))}: exit code {r.returncode} in place of {code}", r.returncode == code, r.stderr[-300:])
        return r

    takes = "a number above 0 and at most 9"
    rows = json.loads(run("slicecorr", "settings", "--json").stdout)
    row = next((r for r in rows if r["name"] == "test_tilt_deg"), None)
    expect("slicecorr settings --json has no row", row is not None)
    expect("slicecorr settings says no range", takes in run("slicecorr", "settings").stdout)
    for program, command in (("slicecorr", "correct"), ("slicecorr", "run"), ("slicecorr", "compare"), ("slicecorr", "plan"),
                             ("slicefarm", "submit")):
        help_text = " ".join(run(program, command, "--help").stdout.split())
        expect(f"{program} {command} --help", "--test-tilt-deg" in help_text and "but that omega-max is not all" in help_text.replace("--", ""))
    expect("slicecorr-post --help", "--test-tilt-deg" in run("slicecorr-post", "--help").stdout)
    for shell in ("bash", "zsh", "fish"):
        expect(f"completion for {shell}", "test-tilt-deg" in run("slicecorr", "--completion", shell).stdout)

    mesh = tree / "tests/data/meshes/clean/ksr_fdmtest_v4.stl"
    setup = ["--printer", "dual-wavelength-dlp", "--resin", "egg-resin", "--speed-mm-h", 800]
    small = [mesh, "--layer-um", 200, "--fit-mm", 6]
    run("slicecorr", "slice", *small, "--printer", "dual-wavelength-dlp", "-o", "part.uvj")
    run("slicecorr", "correct", "part.uvj", "-o", "out.uvj", *setup, "--test-tilt-deg", 3)
    told = run("slicecorr", "info", "out.uvj", "--json", "-").stdout
    expect("info --json does not tell it", json.loads(told).get("test_tilt_deg") == 3, told[:300])
    run("slicecorr", "correct", "part.uvj", "-o", "plain.uvj", *setup)
    expect("a stack that was not asked for it has it", "test_tilt_deg" not in block_of(folder / "plain.uvj"))
    refused = run("slicecorr", "correct", "part.uvj", "-o", "no.uvj", *setup, "--test-tilt-deg", 10, code=2).stderr
    expect("a number out of its range", "--test-tilt-deg" in refused and takes in refused, refused)

    # Jobs: an option, a key of a file, a key of a request.
    (folder / "farm").mkdir(exist_ok=True)
    job = {"part": str(mesh), "printer": "dual-wavelength-dlp", "resin": "egg-resin", "speed_mm_h": 800, "layer_um": 200, "fit_mm": 6}

    def jobs_file(value):
        (folder / "jobs.toml").write_text("[[job]]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in {**job, "test_tilt_deg": value}.items()))
        return "jobs.toml"

    run("slicefarm", "submit", "--dir", "farm", "--dry-run", jobs_file(4))
    refused = run("slicefarm", "submit", "--dir", "farm", "--dry-run", jobs_file(10), code=2).stderr
    expect("a job out of range", "test_tilt_deg" in refused and takes in refused, refused)
    run("slicefarm", "submit", "--dir", "farm", *small, *setup, "--test-tilt-deg", 4)
    run("slicefarm", "run", "--dir", "farm", "--until-empty")
    made = next(iter(folder.glob("**/ksr_fdmtest_v4*.uvj")), None)
    expect("the stack of a job does not have it", made is not None and '"test_tilt_deg"' in block_of(made), str(made))
    served = subprocess.Popen([programs / "slicefarm", "serve", "--dir", "farm", "--listen", "127.0.0.1:0"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        address = re.search(r"http://\S+?(?=[/\s]|$)", served.stdout.readline()).group(0)
        with urllib.request.urlopen(address + "/api/v1/openapi.json") as answer:
            schemas = json.load(answer)["components"]["schemas"]
        key = schemas["JobKeys"]["properties"].get("test_tilt_deg", {})
        # The form of the browser is made from this description.
        expect("JobKeys of the API", (key.get("minimum"), key.get("exclusiveMinimum"), key.get("maximum")) == (0, True, 9) and "x-group" in key, json.dumps(key))
    finally:
        served.terminate()
        served.wait()

    # The C interface, and Python by it.
    code = """
import sys, slicecorr
ask = dict(printer="dual-wavelength-dlp", resin="egg-resin", speed_mm_h=800)
slicecorr.correct("part.uvj", "c.uvj", test_tilt_deg=5, **ask)
try:
    slicecorr.correct("part.uvj", "no.uvj", test_tilt_deg=10, **ask)
except slicecorr.Error as error:
    print(error)
"""
    r = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True,
                       env={**os.environ, "PYTHONPATH": str(programs.parent / "python")})
    expect("Python takes it", r.returncode == 0 and "test_tilt_deg" in r.stdout and takes in r.stdout, r.stdout + r.stderr)
    expect("a stack made by Python does not have it", '"test_tilt_deg"' in block_of(folder / "c.uvj"))


if __name__ == "__main__":
    sys.exit(main())
