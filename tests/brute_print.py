# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What a stack prints, by small steps of time through its images: shares no code with the programs.

Each effect stands in its plainest form. A print is read from the archive (images, and the definitions that
it carries); `Print.doses(heights_um)` are the relative doses of all pixels at some heights, in which nothing
is summed in closed form: for each slice, for each of some steps of the window's way, the light that reaches
the height.
"""

import base64
import functools
import json
import math
import zipfile
import zlib

import numpy as np


def read_png(data):
    """Grey images of 8 bits, or of 1, 2 or 4 spread to them; colours as three numbers of each pixel."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed = 8, b""
    while at < len(data):
        size = int.from_bytes(data[at:at + 4], "big")
        kind, body = data[at + 4:at + 8], data[at + 8:at + 8 + size]
        if kind == b"IHDR":
            width, height = int.from_bytes(body[:4], "big"), int.from_bytes(body[4:8], "big")
            depth, colour = body[8], body[9]
            assert colour in (0, 2) and body[12] == 0
            samples = 3 if colour == 2 else 1
        elif kind == b"IDAT":
            packed += body
        at += 12 + size
    raw = zlib.decompress(packed)
    stride, whole = (width * depth * samples + 7) // 8, max(1, depth * samples // 8)
    rows, before = [], bytearray(stride)
    for y in range(height):
        how, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for x in range(stride):
            left, up = line[x - whole] if x >= whole else 0, before[x]
            corner = before[x - whole] if x >= whole else 0
            if how == 4:
                p = left + up - corner
                guess = min((left, up, corner), key=lambda v: abs(p - v))
            else:
                guess = (0, left, up, (left + up) // 2)[how]
            line[x] = (line[x] + guess) & 255
        rows.append(line)
        before = line
    image = np.array(rows, np.uint8)
    if depth < 8:
        bits = np.unpackbits(image, axis=1).reshape(height, -1, depth)
        values = bits @ (1 << np.arange(depth)[::-1])
        image = (values[:, :width] * 255 // ((1 << depth) - 1)).astype(np.uint8)
    return image.reshape(height, width, 3) if samples == 3 else image


def images_of(archive, folder):
    names = sorted(n for n in archive.namelist() if n.startswith(folder + "/"))
    return np.array([read_png(archive.read(n)) for n in names])


def read_images(path, folder="slice"):
    with zipfile.ZipFile(path) as archive:
        return images_of(archive, folder)


def intensity(levels, calibration):
    return np.interp(levels, [p["level"] for p in calibration], [p["intensity_mw_cm2"] for p in calibration])


@functools.lru_cache(maxsize=None)
def spreading(sigma_um, pitch_um, n):
    """What each of n pixels in a row gets of each: Gaussians integrated over pixels; beyond the display it is dark."""
    if sigma_um == 0:
        return np.eye(n)
    edge = (np.arange(-n, n + 2) - 0.5) * pitch_um / (sigma_um * math.sqrt(2))
    c = np.array([math.erf(e) for e in edge])
    weights = (c[1:] - c[:-1]) / 2
    return weights[n + np.arange(n)[:, None] - np.arange(n)]


def blurred(image, spread, pitch_um):
    """Light of each pixel spread by Gaussians over the window."""
    if not spread:
        return image
    total = sum(weight for _, weight in spread)
    out = np.zeros(image.shape)
    for sigma, share in spread:
        along = [spreading(sigma, pitch_um, n) for n in image.shape]
        out += along[0] @ (image * (share / total)) @ along[1].T
    return out


class Print:
    """`flat`, `uv_flat`: light of each pixel as a share of the calibration's; the archive has its picture elsewhere."""

    def __init__(self, path, flat=None, steps=16, uv_flat=None):
        with zipfile.ZipFile(path) as archive:
            block = json.loads(archive.read("config.json"))["slicecorr"]
            images = images_of(archive, "slice")
            uv_images = images_of(archive, "uv")
        self.steps = steps
        self.layer_um = block["grid"]["layer_um"]
        pitch = block["grid"]["pixel_x_um"]
        printer, resin, process = block["printer"], block["resin"], block["process"]
        self.layers = len(images)
        heights = process.get("layer_heights_um") or [self.layer_um]
        self.heights_um = np.array([heights[min(n, len(heights) - 1)] for n in range(self.layers)])
        self.nodes_um = np.concatenate([[0.0], np.cumsum(self.heights_um)])
        blue = intensity(images, printer["calibration"])
        self.pulses = None
        # Roots of light over the root of the mean: of pulses less, since they are full light and black in turn.
        self.rooted = np.ones(blue.shape)
        if printer.get("grey") == "pulsed":
            # Full light for a share of the time, black light for the rest.
            m, black, full = resin["m"], *(printer["calibration"][i]["intensity_mw_cm2"] for i in (0, -1))
            share = (blue - black) / (full - black)
            mean = (1 - share) * black + share * full
            self.rooted = ((1 - share) * math.sqrt(black) + share * math.sqrt(full)) / np.sqrt(mean)
            blue = (share * full**m + (1 - share) * black**m) ** (1 / m)
            if (process.get("uv") or {"kind": "off"})["kind"] != "off":
                # UV light takes from full light and from black by itself.
                blue, self.pulses = np.full(share.shape, full), (share, black / full)
        if flat is not None:
            blue = blue * flat
        shares = process.get("light_share") or [1]
        blue = np.array([b * shares[min(n, len(shares) - 1)] for n, b in enumerate(blue)])
        self.blue = np.array([blurred(b, gaussians(printer.get("spread")), pitch) for b in blue])
        # Light that scatters: its variance grows with each um of its way.
        self.shown, self.pitch_um = blue, pitch
        self.spread = gaussians(printer.get("spread")) or [(0.0, 1.0)]
        self.scatter = resin.get("scatter_um2_per_um", 0)
        self.rho = printer.get("platform_reflectance", 0)
        self.depth_um = printer.get("resin_depth_um", 0) or math.inf
        self.gel_time = resin["model"] == "gel-time"
        self.he_um = resin["absorbance_height10_um"] / math.log(10)
        self.m = resin["m"]
        self.dose = resin["critical_dose_prime"] or resin["critical_dose_mj_cm3"] * self.he_um * 1e-4
        self.bleaching = resin.get("bleaching")
        self.known = self.films = None
        self.a, self.b = resin.get("gel_a_mj_cm2", 0), resin.get("gel_b_sqrt_mw_cm2_s", 0)
        self.layerwise = block["mode"] == "layerwise"
        self.exposure_s = process.get("exposure_s", 0)
        # What a lift leaves of the dose of what is liquid.
        self.keeps = 1 - process.get("lift_exchange", 0) if process.get("lifts") == "each" else 1
        speeds = process.get("slice_speed_mm_h") or [process["speed_mm_h"]]
        stay = process.get("slice_lamps") == "stay"
        speed = [speeds[min(n, len(speeds) - 1)] if stay else process["speed_mm_h"] for n in range(self.layers)]
        self.um_s = [v / 3.6 for v in speed]
        self.uv = None
        self.gap_um = 0
        uv = process.get("uv") or {"kind": "off"}
        if uv["kind"] != "off":
            inhibition = resin["inhibition"]
            self.m = inhibition["m"]
            self.dose = inhibition["critical_dose_prime"] or self.dose
            self.beta, self.huv_um = inhibition["beta"], inhibition["absorbance_height10_um"] / math.log(10)
            self.steps = max(steps, 256)
            if uv["kind"] == "constant":
                given = [np.full(blue.shape[1:], uv["uv_mw_cm2"])] * self.layers
            elif uv["kind"] == "per_slice":
                given = [np.full(blue.shape[1:], s) for s in uv["slice_mw_cm2"]]
            elif "even_light" in process:
                # The mean of each slice stands for all of it (docs/even-dead-zone.md).
                given = [np.full(blue.shape[1:], s) for s in uv["slice_mw_cm2"]]
                self.flows(process["even_light"], printer["calibration"][-1]["intensity_mw_cm2"] * shares[-1])
            else:
                shown = intensity(uv_images, printer["uv"]["calibration"])
                if uv_flat is not None:
                    shown = shown * uv_flat
                given = [blurred(i, gaussians(printer["uv"].get("spread")), pitch) for i in shown]
            # Light that floods the window is as it was measured; images of an even dead zone make it even.
            if uv_flat is not None and uv["kind"] in ("constant", "per_slice"):
                given = [g * uv_flat for g in given]
            lamp = process.get("uv_lamp_log") or [1]
            self.uv = [given[min(n, len(given) - 1)] * lamp[min(n, len(lamp) - 1)] for n in range(self.layers)]

    def flows(self, light, full):
        """Resin flows under the part, in a gap, with light that is even between a least and a greatest."""
        shares = base64.b64decode(light["blue"])
        self.gap_um = light["gap_um"]
        self.even = (min(shares) / 255 * full, max(shares) / 255 * full)

    def light_of(self, n, d_um):
        """What a slice shines, spread as far as it is at some distances from the window, were nothing absorbed."""
        if not self.scatter:
            return self.blue[n][..., None]
        return np.stack([blurred(self.shown[n], [(math.sqrt(sigma**2 + self.scatter * round(d, 6)), weight)
                                                 for sigma, weight in self.spread], self.pitch_um) for d in d_um], -1)

    def flow_factor(self, n, back):
        """How often the light of the gap counts: so that even light, with what comes back, gels just at the gap."""
        blue = np.clip(self.blue[n] * back, *self.even)[..., None]
        d_um = (np.arange(256) + 0.5) * self.gap_um / 256
        light = blue * np.exp(-d_um / self.he_um)
        light = np.maximum(0, light - self.beta * self.uv[n][..., None] * np.exp(-d_um / self.huv_um))
        still = (light ** self.m).sum(-1) * self.gap_um / 256 / self.um_s[n] / self.dose
        return np.clip(1 / np.maximum(still, 1e-9), 1 / 4, 4)[..., None]

    def looks(self, z_um):
        """Slice, distance from the window, time: what a height gets, one step after the other."""
        for n in range(self.layers):
            if self.layerwise:
                d = self.nodes_um[n + 1] - z_um
                if 0 <= d <= self.depth_um:
                    yield n, np.array([d]), self.exposure_s
                continue
            low, high = max(self.nodes_um[n], z_um), min(self.nodes_um[n + 1], z_um + self.depth_um)
            if high <= low:
                continue
            gap = z_um + self.gap_um
            for low, high in ((low, gap), (gap, high)) if low < gap < high else ((low, high),):
                step = (high - low) / self.steps
                yield n, low + step * (np.arange(self.steps) + 0.5) - z_um, step / self.um_s[n]

    def dose_at(self, z_um, uv=True):
        """Relative dose of all pixels at a height; without `uv` as if no UV light came."""
        back = 1 + self.rho * math.exp(-2 * z_um / self.he_um)
        total = greatest = np.zeros(self.blue.shape[1:])
        lights, roots, times = [], [], []
        for n, d_um, dt in self.looks(z_um):
            light = self.light_of(n, d_um) * np.exp(-d_um / self.he_um) * back
            if self.pulses is not None:
                total = greatest = total + self.of_pulses(n, d_um, uv, back).sum(-1) * dt
                continue
            if uv and self.uv is not None:
                light = np.maximum(0, light - self.beta * self.uv[n][..., None] * np.exp(-d_um / self.huv_um))
            if self.gel_time:
                lights.append(light)
                roots.append(np.sqrt(light) * self.rooted[n][..., None])
                times += [dt] * len(d_um)
            else:
                often = self.flow_factor(n, back) if d_um[-1] < self.gap_um else 1
                total = self.keeps * total + (light ** self.m * often).sum(-1) * dt
                greatest = np.maximum(greatest, total)
        if not self.gel_time:
            return greatest / self.dose
        if not lights:
            return total
        return self.gelled(np.concatenate(lights, -1), np.concatenate(roots, -1), np.array(times))

    def of_pulses(self, n, d_um, uv=True, back=1):
        """Rates at some distances: full light and black light in their shares of the time, with UV light all along."""
        share, black = self.pulses
        light = self.blue[n][..., None] * np.exp(-d_um / self.he_um) * back
        taken = self.beta * self.uv[n][..., None] * np.exp(-d_um / self.huv_um) if uv else 0
        of = [np.maximum(0, part * light - taken) ** self.m for part in (1, black)]
        return share[n][..., None] * of[0] + (1 - share[n])[..., None] * of[1]

    def own_doses(self):
        """Layer by layer: what each exposure by itself leaves at its window, and at its layer's far edge."""
        if self.uv is not None:
            return self.net_own_doses()
        if self.gel_time or self.bleaching:
            return self.alone()
        window = self.blue ** self.m * self.exposure_s / self.dose
        z_um = self.nodes_um[:, None, None]
        if self.scatter:
            # Told as it comes to the far edge, of which the window's is more by what absorbs (docs/spread.md).
            crossed = np.array([self.light_of(n, [h])[..., 0] for n, h in enumerate(self.heights_um)])
            window = crossed ** self.m * self.exposure_s / self.dose
        far = window * np.exp(-self.m * self.heights_um / self.he_um)[:, None, None]

        def back(z):
            return (1 + self.rho * np.exp(-2 * z / self.he_um)) ** self.m
        return window * back(z_um[1:]), far * back(z_um[:-1])

    def alone(self, cells=64):
        """The same of resins whose doses are no sums, in cells of a fresh layer; and what gels as far as a film."""
        doses = []
        for n in range(self.layers):
            nodes = np.linspace(0, self.heights_um[n], cells + 1)
            z_um = self.nodes_um[n + 1] - nodes[:, None, None]
            if self.gel_time:
                back = 1 + self.rho * np.exp(-2 * z_um / self.he_um)
                light = self.blue[n] * np.exp(-nodes / self.he_um)[:, None, None] * back
                x = light * self.exposure_s / self.a
                y = np.sqrt(light) * self.rooted[n] * self.exposure_s / self.b
                doses.append(x * y / np.maximum(x + y, 1e-300))
                continue
            # Light in small steps of time, absorbed by what each cell has had.
            dz, steps = self.heights_um[n] / cells, 256
            fresh, eb = 1 / self.he_um, self.bleaching["dose_mj_cm2"]
            bleached = math.log(10) / self.bleaching["absorbance_height10_um"]
            had = np.zeros((cells + 1,) + self.blue.shape[1:])
            step = self.blue[n] * self.exposure_s / steps

            def gained(had):
                fall = bleached + (fresh - bleached) * np.exp(-had / eb)
                fall = 0.5 * dz * (fall[1:] + fall[:-1])
                return step * np.exp(-np.concatenate([np.zeros((1,) + fall.shape[1:]), np.cumsum(fall, axis=0)]))
            for _ in range(steps):
                had += gained(had + 0.5 * gained(had))
            doses.append(had / self.dose)
        doses = np.array(doses)
        self.films = doses[:, cells // 2] >= 1 - 1e-9
        return doses[:, 0], doses[:, -1]

    def net_own_doses(self):
        """The same under UV light: the greatest dose in the layer, and at its far edge; and how much of it gels."""
        doses = []
        for n in range(self.layers):
            d_um = (np.arange(16) + 1) / 16 * self.heights_um[n]
            back = 1 + self.rho * np.exp(-2 * (self.nodes_um[n + 1] - d_um) / self.he_um)
            if self.pulses is not None:
                doses.append(self.of_pulses(n, d_um, True, back) * self.exposure_s / self.dose)
                continue
            light = self.blue[n][..., None] * np.exp(-d_um / self.he_um) * back
            light = np.maximum(0, light - self.beta * self.uv[n][..., None] * np.exp(-d_um / self.huv_um))
            doses.append(light ** self.m * self.exposure_s / self.dose)
        doses = np.array(doses)
        self.films = (doses >= 1 - 1e-9).mean(-1) >= 0.5
        return doses.max(-1), doses[..., -1]

    def gelled(self, light, root, dt):
        """max over c of min(X, Y): X the dose before the cut c over A, Y that of roots after it over B."""
        zero = np.zeros(light.shape[:-1] + (1,))
        x = np.concatenate([zero, np.cumsum(light * dt, -1)], -1) / self.a
        y = np.cumsum(root * dt, -1) / self.b
        y = np.concatenate([zero, y], -1)
        y = y[..., -1:] - y
        after = np.argmax(x >= y, -1)[..., None]  # the first cut at which they have met
        before = np.maximum(after - 1, 0)
        x0, x1 = np.take_along_axis(x, before, -1), np.take_along_axis(x, after, -1)
        y0, y1 = np.take_along_axis(y, before, -1), np.take_along_axis(y, after, -1)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(after > 0, (y0 - x0) / ((y0 - x0) + (x1 - y1)), 0)
        return (x0 + share * (x1 - x0))[..., 0]

    def followed(self, cells=32):
        """Doses in cells of resin, which absorb by the dose that they have had: all light, in time."""
        dz = np.repeat(self.heights_um / cells, cells)[:, None, None]
        fresh, eb = 1 / self.he_um, self.bleaching["dose_mj_cm2"]
        bleached = math.log(10) / self.bleaching["absorbance_height10_um"]
        dose = np.zeros((self.layers * cells,) + self.blue.shape[1:])

        def gained(had, light):
            fall = (bleached + (fresh - bleached) * np.exp(-had / eb)) * dz[:len(had)]
            after = np.cumsum(fall[::-1], axis=0)[::-1]
            return light * np.exp(-(after - 0.5 * fall))

        def shine(end, light):
            """Light through the cells before `end`, which it bleaches: in the middle of its time as on average."""
            half = dose[:end] + gained(dose[:end], 0.5 * light)
            dose[:end] += gained(half, light)

        for n in range(self.layers):
            for c in range(cells):
                if self.layerwise:
                    shine((n + 1) * cells, self.blue[n] * self.exposure_s / cells)
                    continue
                # While the window passes a cell, those before it are lit through half of it.
                k, dt = n * cells + c, dz[n * cells, 0, 0] / self.um_s[n]
                fall = (bleached + (fresh - bleached) * np.exp(-0.25 * self.blue[n] * dt / eb)) * dz[n * cells, 0, 0]
                shine(k, self.blue[n] * np.exp(-0.5 * fall) * dt)
                dose[k] += self.blue[n] * 0.5 * dt * np.exp(-0.25 * fall)
        return dose / self.dose, cells

    def bleached_doses(self, heights_um):
        self.known = self.known or self.followed()
        dose, cells = self.known
        out = []
        for z_um in heights_um:
            # Between the middles of two cells of the layer: at nodes, those of the one that ends or begins there.
            n = min(int(np.searchsorted(self.nodes_um, z_um + 1e-7 * self.layer_um, "right")) - 1, self.layers - 1)
            place = n * cells + (z_um - self.nodes_um[n]) / self.heights_um[n] * cells
            at = np.clip(math.floor(place - 0.5), n * cells, (n + 1) * cells - 2)
            share = place - 0.5 - at
            out.append(dose[at] + share * (dose[at + 1] - dose[at]))
        return np.array(out)

    def doses(self, heights_um, uv=True):
        if self.bleaching:
            return self.bleached_doses(heights_um)
        return np.array([self.dose_at(z, uv) for z in heights_um])


def gaussians(spread):
    """[[sigma um, weight], ...]"""
    return spread["gaussians"] if spread else []
