# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What pip calls to build the Python module (PEP 517): libslicecorr by CMake, then a wheel of the module with the
library, what it loads, and the files of resins and printers inside. `scripts/package --wheel` calls it, too.

It needs what `scripts/setup --program` installs, and no package of Python: pip, which builds apart, has none to fetch.
The wheel runs where the libraries are that it was built with."""

import base64
import hashlib
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import zipfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
MODULE = ROOT / "libslicecorr/c_api/python/slicecorr"
# Zip files know nothing earlier; the same sources give the same wheel.
MOMENT = (1980, 1, 1, 0, 0, 0)


def version():
    text = (ROOT / "CMakeLists.txt").read_text()
    return re.search(r"^project\(slicecorr VERSION ([0-9.]+)", text, re.M)[1]


def metadata():
    return (
        "Metadata-Version: 2.1\n"
        "Name: slicecorr\n"
        f"Version: {version()}\n"
        "Summary: Corrects slices of resin prints for light that cures through\n"
        "Author: The slicecorr authors\n"
        "License: Apache-2.0\n"
        "Requires-Python: >=3.9\n"
        "Provides-Extra: tomo\n"
        "Requires-Dist: numpy; extra == 'tomo'\n"
        "Description-Content-Type: text/markdown\n"
        "\n" + (ROOT / "README.md").read_text()
    )


def tag():
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    return f"py3-none-{platform}"


def run(*command):
    """What the commands say goes to stderr: stdout is pip's."""
    subprocess.run(command, check=True, stdout=sys.stderr)


def built(build):
    """Builds the library in `build`, which scripts/package uses, too, and which stays for the next wheel."""
    if shutil.which("cmake") is None:
        raise SystemExit("slicecorr: no cmake; scripts/setup --program installs what building needs")
    if not (build / "CMakeCache.txt").exists():
        generator = ["-G", "Ninja"] if shutil.which("ninja") else []
        run("cmake", "-S", ROOT, "-B", build, *generator, "-DCMAKE_BUILD_TYPE=Release", "-DSLICECORR_TESTS=OFF",
            "-DSLICECORR_LOCAL=OFF", "-DCMAKE_INSTALL_PREFIX=/usr", "-DCMAKE_SKIP_INSTALL_RPATH=ON",
            *shlex.split(os.environ.get("CMAKE_ARGS", "")))  # fmt: skip
    jobs = str(os.cpu_count() or 1)
    run("cmake", "--build", build, "--parallel", jobs, "--target", "slicecorr-c", "slicecorr-images", "slicecorr-meshes",
        "slicecorr-tar", "slicecorr-tuning")  # fmt: skip
    return build


def files_of(build):
    """Names in the wheel to what they hold."""
    files = {f"slicecorr/{path.name}": path.read_bytes() for path in sorted(MODULE.glob("*.py"))}
    files["slicecorr/py.typed"] = b""
    library = next(path for path in (build / "lib").glob("libslicecorr.so.*") if not path.is_symlink())
    soname = next(path.name for path in (build / "lib").glob("libslicecorr.so.*") if path.is_symlink())
    files["slicecorr/_location.py"] = f'LIBRARY = "lib/{soname}"\n'.encode()
    files[f"slicecorr/lib/{soname}"] = library.read_bytes()
    for path in sorted((build / "lib/slicecorr").glob("slicecorr-*.so")):
        if path.stem in ("slicecorr-images", "slicecorr-meshes", "slicecorr-tar", "slicecorr-tuning"):
            files[f"slicecorr/lib/slicecorr/{path.name}"] = path.read_bytes()
    for folder, inside in (("db", ""), ("printers", "printers/")):
        for path in sorted((ROOT / "resins" / folder).rglob("*")):
            if path.is_file():
                name = path.relative_to(ROOT / "resins" / folder)
                files[f"slicecorr/share/slicecorr/db/{inside}{name}"] = path.read_bytes()
    return files


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    # pip may build in a copy of the checkout; in one of ours what was built stays.
    build = built(ROOT / "build/release")
    files = files_of(build)
    info = f"slicecorr-{version()}.dist-info"
    files[f"{info}/METADATA"] = metadata().encode()
    files[f"{info}/LICENSE"] = (ROOT / "LICENSE").read_bytes()
    files[f"{info}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: slicecorr\nRoot-Is-Purelib: false\nTag: {tag()}\n".encode()
    record = ""
    for name, data in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        record += f"{name},sha256={digest},{len(data)}\n"
    files[f"{info}/RECORD"] = f"{record}{info}/RECORD,,\n".encode()
    name = f"slicecorr-{version()}-{tag()}.whl"
    whole = pathlib.Path(wheel_directory) / name
    part = whole.with_suffix(".part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as wheel:
        for entry, data in files.items():
            item = zipfile.ZipInfo(entry, MOMENT)
            item.compress_type = zipfile.ZIP_DEFLATED
            item.external_attr = 0o100644 << 16
            wheel.writestr(item, data)
    part.rename(whole)
    return name


def build_sdist(sdist_directory, config_settings=None):
    raise SystemExit("slicecorr: there is no source distribution; build the wheel from a checkout")


if __name__ == "__main__":
    target = pathlib.Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    for old in target.glob("slicecorr-*.whl"):
        old.unlink()
    print(target / build_wheel(target))
