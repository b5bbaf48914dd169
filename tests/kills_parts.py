# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Small inputs for programs that are killed, cut off from their disk, or starved: meshes, an SL1 archive, a printer, a
machine. Shares no code with the programs."""

import contextlib
import hashlib
import json
import os
import struct
import subprocess
import zipfile
import zlib

from docs_machine_faults import box_stl

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

PRINTER = """name = "small"
maker = "Works"
product = "Small One"
[display]
width_px = 160
height_px = 120
pixel_um = 50.0
[blue]
wavelength_nm = 405
calibration = [[0, 1.0], [255, 100.0]]
[stage]
travel_mm = 100
max_speed_mm_h = 2000
"""
LIGHT = ["--printer", "small.toml", "--resin", "figure-2-2", "--ha-um", "110"]
SPEED = ["--speed-mm-h", "800"]

def sha256(path):
    with open(path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def png(width, height, pixels):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + pixels[y * width:(y + 1) * width] for y in range(height))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))


def sl1(path, layers=60, seed=0):
    """A tower with a bridge, as PrusaSlicer packs it."""
    width, height, job = 160, 120, "part"
    with zipfile.ZipFile(path, "w") as out:
        out.writestr("config.ini", f"""action = print
expTime = 0.1
expTimeFirst = 0.2
jobDir = {job}
layerHeight = 0.05
materialName = Figure 2-2
numFade = 4
numFast = {layers}
numSlow = 0
printProfile = 0.05 Normal
printerModel = SL1
printerProfile = Works Small One
""")
        out.writestr("prusaslicer.ini", f"""display_height = {height * 0.05}
display_width = {width * 0.05}
display_mirror_x = 0
display_mirror_y = 0
display_orientation = landscape
display_pixels_x = {width}
display_pixels_y = {height}
layer_height = 0.05
initial_layer_height = 0.05
""")
        for n in range(layers):
            image = bytearray(width * height)
            for y in range(40, 60 + seed):
                for x in list(range(40, 50)) + list(range(100, 110)) + (list(range(50, 100)) if n % 20 > 12 else []):
                    image[y * width + x] = 255
            out.writestr(f"{job}{n:05}.png", png(width, height, bytes(image)))


def hidden(folder):
    """What has a name that people do not see, with all that is in it."""
    found = []
    for at, folders, files in os.walk(folder):
        found += [os.path.join(at, n) for n in folders + files if n.startswith(".")]
    return sorted(os.path.relpath(p, folder) for p in found)


def fast_printer(path, slices, bench_px=(32, 24), travel_mm=2):
    """A machine on Modbus that prints quickly; what it prints is made beside it. Returns the stack's path."""
    from docs_machine_faults import replaced
    with open(os.path.join(ROOT, "resins/printers/dual-wavelength-dlp.toml")) as file:
        text = file.read()
    for what, by in (("width_px = 1280", f"width_px = {bench_px[0]}"), ("height_px = 800", f"height_px = {bench_px[1]}"),
                     ("travel_mm = 100", f"travel_mm = {travel_mm}"), ("lift_mm = 3", "lift_mm = 1"),
                     ("\nwarm_up_s = 2\n", "\nwarm_up_s = 0.1\n"), ("acceleration_mm_s2 = 1.0", "acceleration_mm_s2 = 10")):
        text = replaced(text, what, by)
    with open(path, "w") as file:
        file.write(text)
    folder = os.path.dirname(path)
    mesh, target, stack = (os.path.join(folder, n) for n in ("box.stl", "target.uvj", "box.uvj"))
    box_stl(mesh, 0.8, 0.6, 0.05 * slices)
    return mesh, target, stack


@contextlib.contextmanager
def octoprint(programs, *traps):
    """A printer on the network (OctoPrint's calls), which a farm in the folder `farm` knows as `octo`. Gives its process, and a
    function that asks it for what it knows."""
    peer = subprocess.Popen(["/usr/bin/python3", "-B", os.path.join(ROOT, "tests/machine_peer.py"), "octoprint", "--trap",
                             "resolution=160x120", *traps], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def asked(what):
        peer.stdin.write(what + "\n")
        peer.stdin.flush()
        return json.loads(peer.stdout.readline())
    try:
        port = json.loads(peer.stdout.readline())["port"]
        with open(os.open(programs.path("key"), os.O_CREAT | os.O_WRONLY, 0o600), "w") as file:
            file.write("abcdefgh\n")
        programs.sound("slicefarm", "machines", "add", "octo", "--kind", "octoprint", "--address", f"127.0.0.1:{port}", "--format", "sl1",
                       "--resolution-px", "160,120", "--key-file", programs.path("key"), "--dir", "farm")
        yield peer, asked
    finally:
        peer.stdin.close()
        peer.wait()


class Programs:
    """The built programs, run in one folder with a database of its own and nothing of the user's."""

    def __init__(self, bin_folder, folder):
        self.bin, self.folder = os.path.abspath(bin_folder), folder
        self.environment = {"PATH": os.environ["PATH"], "HOME": folder, "SLICECORR_DB": os.path.join(folder, "db"),
                            "XDG_STATE_HOME": os.path.join(folder, "state"),
                            "SLICECORR_BRIDGE_DIR": os.path.join(folder, "bridge")}
        for name in ("LD_LIBRARY_PATH", "ASAN_OPTIONS", "TSAN_OPTIONS"):
            if name in os.environ:
                self.environment[name] = os.environ[name]
        os.makedirs(os.path.join(folder, "db/printers"), exist_ok=True)
        for place in ("small.toml", "db/printers/small.toml"):
            with open(os.path.join(folder, place), "w") as file:
                file.write(PRINTER)

    def command(self, words):
        return [os.path.join(self.bin, words[0])] + [str(w) for w in words[1:]]

    def start(self, *words, more=None, **how):
        how = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": self.folder,
               "env": {**self.environment, **(more or {})}, "start_new_session": True, **how}
        return subprocess.Popen(self.command(words), **how)

    def run(self, *words, more=None, timeout=120, **how):
        return subprocess.run(self.command(words), cwd=self.folder, env={**self.environment, **(more or {})},
                              stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=timeout, **how)

    def sound(self, *words, **how):
        done = self.run(*words, **how)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(map(str, words))}: {done.returncode}: {done.stderr}")
        return done

    def machine(self, printer, *more):
        """A printer-sim that moves with its bridge's clock, and where it listens."""
        sim = self.start("printer-sim", "--printer", printer, "--listen", "127.0.0.1:0", "--quiet", "--lockstep", *more,
                         stdout=subprocess.PIPE)
        modbus = json.loads(sim.stdout.readline())["modbus"]
        return sim, modbus if modbus.startswith("tcp:") else "tcp:" + modbus

    def path(self, name):
        return os.path.join(self.folder, name)
