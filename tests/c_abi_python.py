# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the Python module `slicecorr`, run by c_abi_python_test.cpp: c_abi_python.py Class...

PYTHONPATH has the module; SLICECORR_BIN the folder of the programs, SLICECORR_SOURCE the sources."""

import contextlib
import io
import json
import math
import os
import pathlib
import re
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import unittest
from unittest import mock

import numpy as np

import slicecorr
from slicecorr import tomo

SOURCE = pathlib.Path(os.environ["SLICECORR_SOURCE"])
PROGRAM = os.path.join(os.environ["SLICECORR_BIN"], "slicecorr")
EXAMPLES = SOURCE / "libslicecorr/c_api/examples"
MODEL = (SOURCE / "resins/printers/model-tomography-bench.toml", SOURCE / "resins/db/model-tomography-resin.toml")

PRINTER = slicecorr.Toml("""name = "bench"
[display]
width_px = 48
height_px = 40
pixel_um = 250.0
bit_depth = 8
[blue]
wavelength_nm = 405
calibration = [[0, 0.002], [255, 2.0]]
[vial]
outer_mm = 4.5
inner_mm = 4.0
n_outside = 1.0
n_wall = 1.48
[optics]
kind = "telecentric"
[rotation]
deg_s = 25
direction = "counterclockwise"
max_fps = 60
""")
RESIN = slicecorr.Toml("""name = "resin"
[cure]
model = "jacobs"
m = 1.0
absorption_per_cm = 0.5
n = 1.5
gel_dose_mj_cm3 = 20.0
""")


def a_part():
    part = np.zeros((3, 15, 15), np.uint8)
    for z in range(3):
        part[z, 3:12, 3:12 - 2 * z] = 255
    return part


def numbers(shape, seed):
    return np.random.default_rng(seed).random(shape, np.float32)


class Operators(unittest.TestCase):
    def test_the_pair_is_transposed(self):
        insert = np.zeros((20, 41, 41), bool)
        insert[:, 12, 20] = True
        for slices in (1, 5, 20):
            for name, projector in {
                "plain": tomo.Projector(41, 36, slices=slices),
                "absorbs": tomo.Projector(41, 36, slices=slices, absorption_per_cm=15),
                "with an insert": tomo.Projector(41, 36, slices=slices, insert=insert[:slices]),
                "behind a vial": tomo.Projector.for_printer(PRINTER, RESIN, 0.25, slices=slices, angles=36),
            }.items():
                with self.subTest(name, slices=slices):
                    x, b = numbers(projector.volume_shape, 1), numbers(projector.light_shape, 2)
                    left = np.vdot(projector.forward(x).astype(float), b.astype(float))
                    right = np.vdot(x.astype(float), projector.adjoint(b).astype(float))
                    # Sums of at most 3 * 41 terms, all above 0, each with up to 8 roundings of 2^-24.
                    self.assertLess(abs(left / right - 1), 130 * 2.0**-24)

    def test_uniform_light_is_the_closed_form(self):
        # docs/tomography.md: dose at r/R 0 and 0.5 over the light, for absorption times R.
        for depth, axis, half in ((0.5, 0.606531, 0.636658), (1, 0.367879, 0.417465), (2, 0.135335, 0.193503)):
            projector = tomo.Projector(201, 720, absorption_per_cm=10 * depth)
            self.assertAlmostEqual(projector.alpha_r, depth, 12)
            mean = projector.adjoint(np.ones(projector.light_shape)) / projector.angles
            # Between pixels light is taken as linear: p^2/8 of the weights' bend, below 2e-5 of it at half the radius.
            self.assertAlmostEqual(mean[0, 100, 100], axis, delta=2e-6)
            self.assertAlmostEqual(mean[0, 100, 150], half, delta=5e-5)

    def test_a_turn_of_the_model_printer(self):
        # alpha 0.8 1/cm, R 12.5 mm, 2 mW/cm², a turn of 14.4 s: 8.4759 mJ/cm³ on the axis.
        projector = tomo.Projector.for_printer(*MODEL, 0.25, angles=360)
        self.assertEqual((projector.voxels, projector.reach_mm, projector.to_gel_mj_cm3), (101, 12.5, 20))
        dose = projector.turn_mj_cm3 * projector.adjoint(np.full(projector.light_shape, projector.most_mw_cm2))
        # Beside it e^(-alpha l), in the mean over directions, is more by r^2 (alpha^2 + alpha / R) / 4, and r^2 is 0.25^2 / 6
        # in the mean over a voxel.
        more = 0.25**2 / 24 * (0.08**2 + 0.08 / 12.5)
        self.assertAlmostEqual(dose[0, 50, 50], 8.4759 * (1 + more), delta=1e-4)

    def test_forward_is_a_line_integral(self):
        projector = tomo.Projector(201, 8)
        h = projector.voxel_mm
        light = projector.forward(projector.inside.astype(np.float32)) * h
        t = (np.arange(201) - 100) * projector.pixel_mm
        for m in (0, 2):
            # The chord's two ends lie somewhere in a voxel; where the disc falls off steeply they count more.
            off = np.abs(light[m] - 2 * np.sqrt(np.maximum(0, 1 - t**2)))[np.abs(t) < 0.9]
            self.assertLess(off.max(), h / math.sqrt(1 - 0.9**2))

    def test_what_counts_is_inside(self):
        for voxels in (2, 9, 40, 41):
            projector = tomo.Projector(voxels, 12, radius_mm=3)
            lit = projector.adjoint(np.ones(projector.light_shape))[0] > 0
            self.assertTrue(np.array_equal(lit, projector.inside))
            self.assertEqual(projector.voxels_mm[-1], 3)

    def test_any_layout_gives_the_same_numbers(self):
        projector = tomo.Projector(41, 36, slices=20, absorption_per_cm=5)
        x = numbers(projector.volume_shape, 3)
        expected = projector.forward(x)
        self.assertEqual(expected.dtype, np.float32)
        wide = np.zeros((20, 82, 43), np.float32)
        wide[:, ::2, 1:42] = x
        layouts = {
            "Fortran's": np.asfortranarray(x),
            "turned": np.ascontiguousarray(x.transpose(1, 2, 0)).transpose(2, 0, 1),
            "part of a larger one": wide[:, ::2, 1:42],
            "from the end": np.ascontiguousarray(x[::-1, ::-1, ::-1])[::-1, ::-1, ::-1],
            "not aligned": np.frombuffer(b"abc" + x.tobytes(), np.uint8)[3:].view(np.float32).reshape(x.shape),
            "the other byte order": x.astype(x.dtype.newbyteorder()),
        }
        for name, array in layouts.items():
            with self.subTest(name):
                self.assertTrue(np.array_equal(projector.forward(array), expected))
        self.assertTrue(np.array_equal(projector.forward(x.tolist()), expected))
        wider = projector.forward(x.astype(np.float64))
        self.assertEqual(wider.dtype, np.float64)
        self.assertTrue(np.array_equal(wider, expected))
        whole = (x > 0.5).astype(np.int16)
        self.assertTrue(np.array_equal(projector.forward(whole), projector.forward(whole.astype(np.float32))))
        one = projector.adjoint(np.broadcast_to(np.float32(1), projector.light_shape))
        self.assertTrue(np.array_equal(one, projector.adjoint(np.ones(projector.light_shape, np.float32))))
        self.assertTrue(np.array_equal(tomo.Projector(41, 36, slices=20, absorption_per_cm=5, threads=1).forward(x),
                                       expected))

    def test_results_go_where_they_are_wanted(self):
        projector = tomo.Projector(41, 36, slices=3)
        x = numbers(projector.volume_shape, 4)
        expected = projector.forward(x)
        frames = np.zeros((36, 3, 41))  # angles first
        out = frames.transpose(1, 0, 2)
        self.assertIs(projector.forward(x, out=out), out)
        self.assertTrue(np.array_equal(frames[:, 2], expected[2]))
        read_only = np.zeros(projector.light_shape, np.float32)
        read_only.flags.writeable = False
        for wrong, error in ((read_only, ValueError), (np.zeros(projector.light_shape, np.uint8), TypeError),
                             (np.zeros((3, 36, 40)), ValueError), ([0], TypeError),
                             (np.broadcast_to(np.zeros((1, 36, 41)), projector.light_shape), (ValueError, TypeError))):
            with self.assertRaises(error):
                projector.forward(x, out=wrong)
        same = tomo.Projector(36, 36)
        memory = numbers((1, 36, 36), 5)
        with self.assertRaisesRegex(ValueError, "shares memory"):
            same.forward(memory, out=memory)

    def test_one_slice_needs_no_axis(self):
        projector = tomo.Projector(41, 36)
        x = numbers((41, 41), 6)
        light = projector.forward(x)
        self.assertEqual(light.shape, (36, 41))
        self.assertTrue(np.array_equal(projector.forward(x[np.newaxis])[0], light))
        self.assertEqual(projector.adjoint(light).shape, (41, 41))
        with self.assertRaises(ValueError):
            tomo.Projector(41, 36, slices=2).forward(x)

    def test_what_does_not_fit_is_refused(self):
        projector = tomo.Projector(41, 36, slices=3)
        x = numbers(projector.volume_shape, 7)
        with self.assertRaisesRegex(slicecorr.InputError, r"volume has the shape \(3, 41, 40\); expected \(3, 41, 41\)"):
            projector.forward(x[:, :, 1:])
        with self.assertRaisesRegex(ValueError, r"light has the shape \(3, 41, 41\)"):
            projector.adjoint(x)
        for dtype in (np.complex64, "U1", object):
            with self.assertRaisesRegex(TypeError, "volume has numbers of type"):
                projector.forward(x.astype(dtype))
        for value in (np.nan, np.inf, -np.inf):
            wrong = x.astype(np.float64)
            wrong[2, 0, 40] = value
            with self.assertRaisesRegex(slicecorr.InputError, r"volume\[2, 0, 40\] is -?(nan|inf)"):
                projector.forward(wrong)
        with self.assertRaisesRegex(slicecorr.InputError, r"light\[0, 0, 0\] is 1e\+39"):
            projector.adjoint(np.full(projector.light_shape, 1e39))
        for arguments in ({"voxels": 1}, {"angles": 2}, {"slices": 0}, {"radius_mm": -1}, {"absorption_per_cm": -1},
                          {"absorption_per_cm": float("nan")}, {"insert": np.zeros((1, 40, 40), bool)},
                          {"threads": -1}):
            with self.assertRaises(slicecorr.InputError, msg=str(arguments)):
                tomo.Projector(**{"voxels": 41, "angles": 36, **arguments}).forward(np.zeros((1, 41, 41)))
        with self.assertRaises(TypeError):
            tomo.Projector(41, 36, insert=np.zeros((1, 41, 41), np.float32))
        with self.assertRaisesRegex(slicecorr.InputError, "no printer 'none-such'"):
            tomo.Projector.for_printer("none-such", RESIN, 0.25)
        with self.assertRaisesRegex(slicecorr.Error, "no setting 'colour'"):
            tomo.Projector.for_printer(PRINTER, RESIN, 0.25, colour="red")

    def test_filtered_start(self):
        projector = tomo.Projector(41, 60, slices=2)
        part = np.zeros(projector.volume_shape, np.uint8)
        part[:, 12:29, 15:26] = 255
        light = projector.filtered_start(part)
        self.assertEqual((light.shape, light.min(), light.max()), (projector.light_shape, 0, 1))
        self.assertTrue(np.array_equal(projector.filtered_start(part == 255), light))
        self.assertFalse(np.array_equal(projector.filtered_start(part, "ram-lak"), light))
        dose = projector.adjoint(light)
        self.assertGreater(dose[part == 255].mean(), 3 * dose[(part == 0) & projector.inside].mean())
        with self.assertRaisesRegex(slicecorr.InputError, "no window 'hann'; expected hamming, ram-lak, kelly"):
            projector.filtered_start(part, "hann")
        with self.assertRaises(TypeError):
            projector.filtered_start(part.astype(np.float32))
        with self.assertRaisesRegex(slicecorr.InputError, "no voxel inside the vial is wholly part"):
            projector.filtered_start(np.zeros_like(part))

    def test_threads_share_a_projector(self):
        projector = tomo.Projector(41, 36, slices=20, absorption_per_cm=3)
        inputs = [numbers(projector.volume_shape, seed) for seed in range(8)]
        expected = [projector.forward(x) for x in inputs]
        made = [None] * 8

        def work(i):
            for _ in range(5):
                made[i] = projector.forward(inputs[i])

        threads = [threading.Thread(target=work, args=(i,)) for i in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for got, want in zip(made, expected):
            self.assertTrue(np.array_equal(got, want))


class SciPy(unittest.TestCase):
    def test_linear_operator(self):
        from scipy.sparse.linalg import lsmr

        projector = tomo.Projector(21, 30, slices=2, absorption_per_cm=4)
        operator = projector.as_linear_operator()
        self.assertEqual(operator.shape, (2 * 30 * 21, 2 * 21 * 21))
        self.assertEqual(operator.dtype, np.float64)
        x, b = numbers(operator.shape[1], 1), numbers(operator.shape[0], 2)
        self.assertTrue(np.array_equal(operator @ x, projector.forward(x.reshape(2, 21, 21)).ravel()))
        self.assertTrue(np.array_equal(operator.T @ b, projector.adjoint(b.reshape(2, 30, 21)).ravel()))
        self.assertEqual((operator @ np.stack([x, x], 1)).shape, (operator.shape[0], 2))
        # Light whose dose is that of other light: its dose, though not the light itself, is found again.
        dose = operator.T @ b
        found = lsmr(operator.T, dose, maxiter=200)[0]
        self.assertLess(np.linalg.norm(operator.T @ found - dose), 1e-3 * np.linalg.norm(dose))

    def test_the_example_finds_light(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "own.frames")
            # As if called by its name, in this interpreter, which has imported what it needs.
            said = io.StringIO()
            with mock.patch.object(sys, "argv", [str(EXAMPLES / "own_optimiser.py"), path, *map(str, MODEL)]):
                with contextlib.redirect_stdout(said):
                    runpy.run_path(sys.argv[0], run_name="__main__")
            told = re.fullmatch(r"(\d+) turns, contrast ([\d.]+), void that gels ([\d.]+)\n", said.getvalue())
            self.assertIsNotNone(told, said.getvalue())
            # It stops where void gets at most 1/1.25 of the part's least; levels of 8 bits cost a little.
            self.assertGreater(float(told[2]), 1.2)
            self.assertEqual(float(told[3]), 0)
            judged = subprocess.run([PROGRAM, "--quiet", "tomo", "verify", path, "--json", "-"], capture_output=True,
                                    text=True)
            self.assertEqual(judged.returncode, 0, judged.stderr)
            self.assertEqual(json.loads(judged.stdout)["turns"], int(told[1]))


class Jobs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        (self.folder / "bench.toml").write_text(PRINTER)
        (self.folder / "resin.toml").write_text(RESIN)

    def program(self, *words):
        return subprocess.run([PROGRAM, "--quiet", "tomo", *words], cwd=self.folder, capture_output=True, text=True)

    def test_the_programs_bytes_and_figures(self):
        part = a_part()
        insert = np.zeros_like(part)
        insert[:, 13, 13] = 1
        np.save(self.folder / "part.npy", part)
        np.save(self.folder / "insert.npy", insert)
        for more, options, words in (({}, {}, []),
                                     ({"insert": insert}, {"method": "osmo", "iterations": 15, "window": "kelly", "clip_sigma": 4},
                                      ["--insert", "insert.npy", "--method", "osmo", "--iterations", "15", "--window",
                                       "kelly", "--clip-sigma", "4"])):
            done = self.program("solve", "--volume", "part.npy", "--voxel-mm", "0.25", "--printer", "bench.toml", "--resin",
                                "resin.toml", "-o", "p.frames", "--angles", "60", "--json", "-", *words)
            self.assertIn(done.returncode, (0, 5), done.stderr)
            job = tomo.solve(part, 0.25, PRINTER, RESIN, angles=60, **more, **options)
            self.assertEqual(job.figures, json.loads(done.stdout))
            job.save(self.folder / "m.frames")
            self.assertEqual((self.folder / "m.frames").read_bytes(), (self.folder / "p.frames").read_bytes())

            verified = self.program("verify", "m.frames", "--dose", "d.npy", "--json", "-")
            loaded = tomo.load(self.folder / "p.frames")
            self.assertEqual(loaded.figures, json.loads(verified.stdout))
            self.assertTrue(np.array_equal(loaded.dose(), np.load(self.folder / "d.npy")))
            loaded.save(self.folder / "again.frames")
            self.assertEqual((self.folder / "again.frames").read_bytes(), (self.folder / "p.frames").read_bytes())
            self.assertEqual(job.frames.shape, (60, 40, 48))
            self.assertTrue(np.array_equal(job.frames, loaded.frames))
            self.assertTrue(np.array_equal(job.frame(59), job.frames[59]))
            self.assertEqual((job.turns, job.print_time_s, job.clockwise),
                             (job.figures["turns"], job.figures["print_time_s"], False))

    def test_light_and_part(self):
        part = a_part()
        job = tomo.solve(part == 255, 0.25, PRINTER, RESIN, angles=60, method="fbp")
        beside = (job.voxels - 15) // 2
        self.assertTrue(np.array_equal(job.part[:, beside:-beside, beside:-beside], part))
        self.assertEqual(int(job.part.sum()), int(part.sum()))
        light = job.light()
        again = tomo.job_of_light(light, part, 0.25, PRINTER, RESIN, turns=job.turns)
        self.assertTrue(np.array_equal(again.frames, job.frames))
        self.assertEqual(again.figures, job.verify())
        # The projector and the direct sum weigh light between pixels otherwise: tests/tomo_print_test.cpp.
        projector = tomo.Projector.for_printer(PRINTER, RESIN, 0.25, slices=3, angles=60)
        self.assertEqual(projector.light_shape, job.light_shape)
        dose = projector.turn_mj_cm3 * job.turns * projector.adjoint(light)
        self.assertLess(np.abs(dose - job.dose())[:, beside:-beside, beside:-beside].max(), 0.1 * dose.max())
        other = part.copy()
        other[0] = 0
        self.assertEqual(job.verify(other)["gel_voxels"], int((other == 255).sum()))
        flat = tomo.solve(part[0], 0.25, PRINTER, RESIN, angles=60, method="fbp")
        self.assertEqual(flat.slices, 1)

    def test_what_can_not_be_is_told(self):
        part = a_part()

        def solve(part=part, voxel_mm=0.25, printer=PRINTER, resin=RESIN, **more):
            return tomo.solve(part, voxel_mm, printer, resin, **{"angles": 60, "method": "fbp", **more})

        with self.assertRaisesRegex(slicecorr.InfeasibleError, "longer than the 1 s allowed") as caught:
            solve(max_time_s=1)
        self.assertEqual(caught.exception.status, 3)
        wide = np.zeros((1, 27, 27), np.uint8)
        wide[0, 13, 0] = 255  # at 3.25 mm, light from all directions reaches 4.5 / 1.5
        with self.assertRaisesRegex(slicecorr.InputError, "scaled by at most"):
            solve(wide)
        self.assertEqual(solve(wide, beyond_reach=True).slices, 1)
        for wrong, error in ((part.astype(np.float32), TypeError), (part[0, 0], ValueError), (part[:, 1:], ValueError),
                             (np.zeros_like(part), ValueError), (part[:0], ValueError)):
            with self.assertRaises(error):
                solve(wrong)
        for options, error in (({"method": "guess"}, slicecorr.InputError), ({"window": "hann"}, slicecorr.InputError),
                               ({"angles": 2}, slicecorr.InputError), ({"voxel_mm": -1}, slicecorr.InputError),
                               ({"voxel_mm": float("nan")}, slicecorr.InputError), ({"iterations": 2.5}, slicecorr.InputError),
                               ({"speed": 3}, slicecorr.Error), ({"angles": True}, TypeError),
                               ({"printer": "none-such"}, slicecorr.InputError),
                               ({"printer": slicecorr.Toml("name = ")}, slicecorr.InputError),
                               ({"insert": part[:1]}, slicecorr.InputError), ({"insert": part}, slicecorr.InputError)):
            with self.assertRaises(error, msg=str(options)):
                solve(**options)
        with self.assertRaisesRegex(slicecorr.InputError, "none.frames"):
            tomo.load(self.folder / "none.frames")
        with self.assertRaises(slicecorr.DeviceError):
            solve().save("/no/such/folder/a.frames")
        light = solve().light()
        for wrong in (light[:, :, 1:], light[:2], np.where(light >= 0, np.nan, light)):
            with self.assertRaises(slicecorr.InputError):
                tomo.job_of_light(wrong, part, 0.25, PRINTER, RESIN, turns=1)
        with self.assertRaises(slicecorr.InputError):
            tomo.job_of_light(light, part, 0.25, PRINTER, RESIN, turns=0)

    def test_progress_and_stopping(self):
        told = []
        job = tomo.solve(a_part(), 0.25, PRINTER, RESIN, angles=24, notice=told.append)
        self.assertTrue(told)
        stages = []
        job.dose(progress=lambda stage, fraction: stages.append((stage, fraction)))
        self.assertEqual((stages[0], stages[-1]), (("judge", 0), ("judge", 1)))

        def fail(*_):
            raise KeyError("mine")

        with self.assertRaisesRegex(KeyError, "mine"):
            job.dose(progress=fail)
        with self.assertRaisesRegex(KeyError, "mine"):
            tomo.solve(a_part(), 0.25, PRINTER, RESIN, angles=24, notice=fail)
        # Ctrl-C, once, when the first rung is done.
        sent = []

        def interrupt(_):
            if not sent:
                sent.append(True)
                os.kill(os.getpid(), signal.SIGINT)

        with self.assertRaises(KeyboardInterrupt):
            tomo.solve(a_part(), 0.25, PRINTER, RESIN, angles=24, notice=interrupt)
        # All goes on as before.
        self.assertEqual(tomo.solve(a_part(), 0.25, PRINTER, RESIN, angles=24).figures, job.figures)


DISPLAY = """name = "small"
[display]
width_px = 96
height_px = 64
pixel_um = 50.0
[blue]
wavelength_nm = 405
calibration = [[0, 1.0], [255, 100.0]]
[stage]
travel_mm = 100
"""


class Archives(unittest.TestCase):
    def test_parts_inside(self):
        """As the program corrects it, beside supports; paths may be several, and paths of pathlib."""
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "small.toml").write_text(DISPLAY)
            light = {"printer": folder / "small.toml", "resin": SOURCE / "resins/db/figure-2-2.toml", "speed_mm_h": 1000}

            def write(file, *boxes):
                (folder / file).write_text("".join(box_obj(k, *box) for k, box in enumerate(boxes)))
                return folder / file

            def program(*words):
                done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)

            part = [((0, 0, 1), (2, 1, 3)), ((2, 0, 2), (3, 1, 3))]
            raft = ((-0.5, -0.5, 0), (3.5, 1.5, 0.5))
            mesh, other = write("part.obj", *part), write("raft.obj", raft)
            source, made, expected = folder / "all.uvj", folder / "made.uvj", folder / "expected.uvj"
            program("slice", write("all.obj", *part, raft), "-o", source, "--printer", light["printer"],
                    "--layer-um", 50)
            options = [text for key, value in light.items() for text in ("--" + key.replace("_", "-"), value)]

            program("correct", source, "-o", expected, "--part", mesh, *options)
            told = []
            figures = slicecorr.correct(source, made, part_inside=mesh, notice=told.append, **light)
            self.assertEqual(made.read_bytes(), expected.read_bytes())
            self.assertGreater(figures["left_alone_voxels"], 0)
            self.assertTrue(any("part.obj: found at" in text for text in told), told)
            both = slicecorr.correct(source, made, part_inside=[mesh, str(other)], **light)
            self.assertLess(both.get("left_alone_voxels", 0), figures["left_alone_voxels"])
            for wrong in (folder / "none.obj", f"{mesh}\n{folder}/none.obj", [f"{folder}/a\nb.obj"]):
                with self.assertRaises(slicecorr.InputError) as caught:
                    slicecorr.correct(source, made, part_inside=wrong, **light)
                self.assertEqual(caught.exception.status, 2)

    def test_scans(self):
        """As the program compares a scan; of another part it is refused."""
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "small.toml").write_text(DISPLAY)

            def program(*words):
                done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                return done.stdout

            boxes = [((0, 0, 0), (2.2, 1.6, 0.4)), ((0, 0, 0.4), (0.6, 1.6, 2)), ((0.6, 0, 1), (2, 0.7, 1.4))]
            part, stack, printed = folder / "part.obj", folder / "part.uvj", folder / "printed.ply"
            part.write_text("".join(box_obj(k, *box) for k, box in enumerate(boxes)))
            (folder / "other.obj").write_text("".join(box_obj(0, (0, 0, 0), (2, 2, 2))))
            program("run", part, "-o", stack, "--printer", folder / "small.toml", "--layer-um", 50, "--resin",
                    SOURCE / "resins/db/figure-2-2.toml", "--speed-mm-h", 1000)
            program("solid", stack, "-o", printed)
            told = program("scan", "compare", printed, "--stack", stack, "--design", part, "--scan-unit", "mm", "--json", "-")
            expected = json.loads(told)
            figures = slicecorr.scan_compare(printed, stack, design=part, scan_unit="mm")
            self.assertEqual(figures, expected)
            self.assertLess(figures["deviations"][1]["max_abs_um"], 0.01)
            with self.assertRaises(slicecorr.InputError) as caught:
                slicecorr.scan_compare(folder / "other.obj", stack)
            self.assertIn("another part", str(caught.exception))


class Scans(unittest.TestCase):
    """Tuning by scans."""

    def test_scans_make_the_next_print_right(self):
        """As the program tunes; the next correction, by what was found, is right by what is true."""
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "small.toml").write_text(DISPLAY)

            def program(*words):
                done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                return done.stdout

            resin = 'name = "{}"\n[cure]\nabsorbance_height_um = {}\nabsorbance_base = 10\ncritical_dose_mj_cm3 = {}\n'
            believed, real = folder / "believed.toml", folder / "real.toml"
            believed.write_text(resin.format("believed", 600, 576))
            real.write_text(resin.format("real", 636, 576 * 1.04 / 1.06))
            boxes = [((0, 0, 0), (2.2, 1.6, 0.4)), ((0, 0, 0.4), (0.6, 1.6, 3)), ((0.6, 0, 1), (2, 0.7, 1.4)),
                     ((0.6, 0.9, 2), (1.6, 1.6, 2.5))]
            part, target = folder / "part.obj", folder / "target.uvj"
            stack, printed, after = folder / "part.uvj", folder / "printed.ply", folder / "next.uvj"
            part.write_text("".join(box_obj(k, *box) for k, box in enumerate(boxes)))
            printer = folder / "small.toml"
            program("slice", part, "-o", target, "--printer", printer, "--layer-um", 50)
            program("correct", target, "-o", stack, "--printer", printer, "--resin", believed, "--speed-mm-h", 600)
            program("solid", stack, "-o", printed, "--resin", real)
            found = slicecorr.tune_scans([printed], stack, printer=printer, resin=believed, scan_unit="mm")
            told = program("tune", "--scan", printed, "--stack", stack, "--printer", printer, "--resin", believed,
                           "--scan-unit", "mm")
            self.assertTrue(told.startswith(found["text"]), (told, found["text"]))
            self.assertTrue(found["inputs"]["absorbance_height_ln"]["told"])
            self.assertAlmostEqual(found["inputs"]["absorbance_height_ln"]["change"], math.log(636 / 600), places=3)
            self.assertLess(found["rms_after_um"], 0.1 * found["rms_before_um"])
            slicecorr.correct(target, after, printer=slicecorr.Toml(found["printer_toml"]),
                              resin=slicecorr.Toml(found["resin_toml"]), speed_mm_h=600)

            def off(which):
                text = program("verify", which, "--target", target, "--printer", printer, "--resin", real, "--speed-mm-h", 600,
                               "--json", "-")
                return json.loads(text)["height_error_um"]["mean_abs"]

            self.assertGreater(off(stack), 3)
            self.assertLess(off(after), 0.25 * off(stack))
            (folder / "other.obj").write_text("".join(box_obj(0, (0, 0, 0), (2, 2, 2))))
            with self.assertRaises(slicecorr.InputError) as caught:
                slicecorr.tune_scans([folder / "other.obj"], stack, printer=printer, resin=believed)
            self.assertIn("another part", str(caught.exception))
            with self.assertRaises(slicecorr.InputError) as caught:
                slicecorr.tune_scans([printed], target, printer=printer, resin=believed)
            self.assertIn("no corrected stack", str(caught.exception))


def box_obj(number, low, high):
    """A box, as the `number`th of an OBJ file."""
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    faces = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    return ("".join("v {} {} {}\n".format(*c) for c in corners)
            + "".join("f " + " ".join(str(8 * number + i) for i in face) + "\n" for face in faces))


class Module(unittest.TestCase):
    def test_archives_need_no_numpy(self):
        done = subprocess.run([sys.executable, "-c", "import sys; sys.modules['numpy'] = None; import slicecorr\n"
                               "print(slicecorr.version())\n"
                               "try: slicecorr.correct('/none.uvj', '/made.uvj', resin='x')\n"
                               "except slicecorr.InputError as e: print(e)\n"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"^\d+\.\d+\.\d+\n/none\.uvj")

    def test_a_library_that_is_not_there_is_named(self):
        done = subprocess.run([sys.executable, "-c", "import slicecorr"], capture_output=True, text=True,
                              env={**os.environ, "SLICECORR_LIBRARY": "/none/libslicecorr.so.0"})
        self.assertEqual(done.returncode, 1)
        self.assertIn("ImportError: /none/libslicecorr.so.0 can't be loaded", done.stderr)

    def test_all_names_are_explained(self):
        for module in (slicecorr, tomo):
            for name in module.__all__:
                self.assertTrue(getattr(module, name).__doc__ or name in ("Figures", "Progress"), name)

    def test_handles_are_freed(self):
        def resident():
            return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * 4096

        def round_trip():
            projector = tomo.Projector(201, 60, slices=32)  # 5 MB of blocks and as much of arrays
            projector.adjoint(projector.forward(np.ones(projector.volume_shape, np.float32)))

        round_trip()
        before = resident()
        # A leak of either would be 120 MB; threads that come and go keep some of their own.
        for _ in range(24):
            round_trip()
        self.assertLess(resident() - before, 80e6)


class Documents(unittest.TestCase):
    def test_the_page_runs(self):
        text = (SOURCE / "docs/python.md").read_text()
        example = (EXAMPLES / "own_optimiser.py").read_text()
        self.assertIn("```python\n" + example + "```", text)
        blocks = [b for b in re.findall(r"```python\n(.*?)```", text, re.S) if b != example]
        self.assertGreater(len(blocks), 3)
        # A solve of a few angles shows as well that the page runs, in a twentieth of the time.
        self.assertEqual(blocks[-1].count("angles=90"), 1)
        blocks[-1] = blocks[-1].replace("angles=90", "angles=12")
        scope = {}
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            os.environ["SLICECORR_DB"] = os.pathsep.join([str(SOURCE / "resins")])
            here = os.getcwd()
            os.chdir(folder)
            try:
                for block in blocks:
                    exec(compile(block, "docs/python.md", "exec"), scope)
            finally:
                os.chdir(here)


if __name__ == "__main__":
    unittest.main()
