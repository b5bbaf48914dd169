// The dose along a column with what each slice adds to it: phi_n (a^(n-k) - a^(n+1-k)) at node k <= n; layer by layer
// phi'_n a^(n+1-k). What slices before m add up to at zeta < m is Omega(zeta) - Omega(m) a^(m - zeta), in both modes:
// no sums needed. Under UV light and in a bath that ends there is no such form, and their doses are summed once for
// each m.
function curveOf(levels, gain) {
  const doses = dosesOf(levels, levels.length, gain), { phi, omega } = doses, a = data.a;
  const between = (p, q, t) => (p > 0 && q > 0 ? p * (q / p) ** t : p + t * (q - p));
  const inLayer = (d, n, zeta) => {
    const up = n + 1 - zeta;
    if (data.kernel) return up < 0.5 ? between(d.lower[n], d.middle[n], 2 * up) : between(d.middle[n], d.omega[n], 2 * up - 1);
    if (data.layerwise) return d.lower[n] * a ** up;
    return d.counted[n] + (d.omega[n + 1] - d.counted[n]) * a ** up;
  };
  const outside = (zeta) => zeta < 0 || zeta >= phi.length;
  const own = (zeta) => (outside(zeta) ? 0 : inLayer(doses, Math.floor(zeta), zeta));
  const at = (zeta) => own(zeta) * returned(zeta);
  const partial = new Map();
  const before = (m, zeta) => {
    if (zeta >= m || outside(zeta)) return 0;
    if (!data.kernel && !data.bath) return Math.max(0, own(zeta) - omega[m] * a ** (m - zeta)) * returned(zeta);
    if (!partial.has(m)) partial.set(m, dosesOf(levels, m, gain));
    return inLayer(partial.get(m), Math.floor(zeta), zeta) * returned(zeta);
  };
  // What slice n adds at the upper end of layer k.
  const add = (n, k) => {
    if (data.kernel || data.bath) return before(n + 1, k) - before(n, k);
    return (data.layerwise ? phi[n] * a ** (n + 1 - k) : phi[n] * (a ** (n - k) - a ** (n + 1 - k))) * returned(k);
  };
  const top = (from, to) =>
    Math.max(0, ...doses.lower.slice(from, to).map((d, i) => d * returned(from + i + 1)), ...omega.slice(from, to + 1).map((d, i) => d * returned(from + i)));
  return { phi, omega: omega.map((d, k) => d * returned(k)), at, before, add, top };
}

const hues = [210, 30, 150, 270, 60, 330, 180, 0];
const bandColour = (i) => `hsl(${hues[i % hues.length]} 55% ${i % 16 < 8 ? 58 : 46}%)`;

function roundStep(range) {
  const power = 10 ** Math.floor(Math.log10(range / 4));
  for (const f of [1, 2, 2.5, 5]) if (range / (power * f) <= 9) return power * f;
  return power * 10;
}

function columnPlot(title, levels, coverage, from, to, top, gain) {
  const W = 860, H = 300, L = 56, R = 56, T = 34, B = 44, floor = H - B;
  const um = data.voxelUm[2];
  const x = (zeta) => (L + (zeta - from) / (to - from) * (W - L - R)).toFixed(1);
  const y = (dose) => (floor - Math.min(1, dose / top) * (floor - T)).toFixed(1);
  const curve = curveOf(levels, gain);
  const inside = Math.max(1, Math.min(8, Math.floor(600 / (to - from))));
  const points = [];
  for (let n = from; n < to; ++n) {
    for (let i = 0; i < inside; ++i) points.push(n + i / inside);
    // Layer by layer the dose jumps at the node.
    if (data.layerwise) points.push(n + 1 - 1e-9);
  }
  points.push(to);
  let svg = `<svg viewBox="0 0 ${W} ${H}" role="img" class="plot" aria-label="${title}: dose along the column, with what slices add">` +
    `<text x="${L}" y="18" class="h">${title}</text>`;
  for (let n = from; n < to;) {
    let end = n;
    while (end < to && coverage[end] === coverage[n]) ++end;
    if (coverage[n]) svg += `<rect class="design" x="${x(n)}" y="${T}" width="${(x(end) - x(n)).toFixed(1)}" height="${floor - T}" fill-opacity="${(0.28 * coverage[n] / 255).toFixed(2)}"/>`;
    n = end;
  }
  // Groups of slices, at most 60 of them, of those that reach into the range.
  const last = Math.min(levels.length, Math.ceil(to + 6 / -Math.log10(data.a)));
  const group = Math.max(1, Math.ceil((Math.min(last, to + 20) - from) / 60));
  const cuts = [];
  for (let m = from + group; m < Math.min(last, to + 20); m += group) cuts.push(m);
  cuts.push(levels.length);
  let drawn = 0;
  for (let c = cuts.length; c-- > 0;) {
    const zetas = points.filter((z) => z <= cuts[c]);
    const path = zetas.map((z) => `${x(z)} ${y(curve.before(cuts[c], z))}`).join("L");
    svg += `<path d="M${x(from)} ${floor}L${path}L${x(zetas[zetas.length - 1])} ${floor}Z" fill="${bandColour(c)}" fill-opacity="${c === cuts.length - 1 ? 0.35 : 0.8}"/>`;
    ++drawn;
  }
  for (let z = Math.ceil(from * um / roundStep((to - from) * um)) * roundStep((to - from) * um); z <= to * um * 1.0001; z += roundStep((to - from) * um)) {
    svg += `<text x="${x(z / um)}" y="${floor + 16}" class="tick" text-anchor="middle">${+z.toPrecision(6)}</text>`;
  }
  for (let d = 0; d <= top; d += roundStep(top)) svg += `<text x="${L - 6}" y="${+y(d) + 4}" class="tick" text-anchor="end">${+d.toPrecision(4)}</text>`;
  const most = data.phi.length - 1, greyY = (g) => (floor - g / most * (floor - T)).toFixed(1);
  for (const g of [0, most]) svg += `<text x="${W - R + 6}" y="${+greyY(g) + 4}" class="tick grey">${g}</text>`;
  svg += `<text x="${(L + W - R) / 2}" y="${H - 8}" class="tick" text-anchor="middle">z from the platform, um</text>` +
    `<text x="14" y="${H / 2}" class="tick" transform="rotate(-90 14 ${H / 2})" text-anchor="middle">dose / critical dose</text>` +
    `<text x="${W - 8}" y="${H / 2}" class="tick grey" transform="rotate(-90 ${W - 8} ${H / 2})" text-anchor="middle">grey level</text>` +
    `<line class="gel" x1="${L}" x2="${W - R}" y1="${y(1)}" y2="${y(1)}"/>`;
  let steps = "";
  for (let n = from; n < Math.min(to, levels.length); ++n) steps += `${steps ? "L" : "M"}${x(n)} ${greyY(levels[n])}H${x(n + 1)}`;
  svg += `<path class="steps" d="${steps}"/>`;
  svg += `<path class="dose" d="M${points.map((z) => `${x(z)} ${y(curve.at(z))}`).join("L")}"/>`;
  // What is wrong, along the axis: voxels are judged at mid-layer, as everywhere.
  let wrong = { through: 0, under: 0 };
  let bars = { through: "", under: "" };
  for (let n = 0; n < Math.max(levels.length, coverage.length); ++n) {
    const printed = curve.at(n + 0.5) >= 1, c = coverage[n] ?? 0;
    const kind = c === 0 && printed ? "through" : c === 255 && !printed ? "under" : null;
    if (!kind) continue;
    ++wrong[kind];
    if (n >= from && n < to) bars[kind] += `M${x(n)} ${floor - 3}H${x(n + 1)}`;
  }
  svg += `<path class="wrong-through" d="${bars.through || "M0 0"}"/><path class="wrong-under" d="${bars.under || "M0 0"}"/>`;
  const here = (view.slice + 0.5) * data.step[2];
  if (here >= from && here <= to) svg += `<line class="here" x1="${x(here)}" x2="${x(here)}" y1="${T}" y2="${floor}" stroke-dasharray="6 5"/>`;
  return { svg: svg + "</svg>", wrong, group, bands: drawn };
}

async function columnAt(i, j) {
  const columns = await load.columns(), every = data.columnEvery;
  return columns(Math.floor(j / every) * Math.ceil(data.cells[0] / every) + Math.floor(i / every));
}

async function drawColumn() {
  const column = await columnAt(view.column, view.row);
  if (!(await loadKernel())) {
    $("column-words").textContent = "The intensities of light differ in too many slices or places for this page to hold what is needed to draw columns under UV light.";
    return { column, plots: [] };
  }
  const coverage = unrolled(column.coverage), after = unrolled(column.levels);
  const before = coverage.map(levelOfPixel);
  const all = Math.max(before.length, after.length);
  let from = 0, to = all;
  if (document.querySelector("input[name=range]:checked").value === "near") {
    from = Math.max(0, Math.min(all - 40, view.slice * data.step[2] - 20));
    to = Math.min(all, from + 40);
  }
  let top = 1.2;
  const gains = [column.lightBefore ?? column.gain, column.lightAfter ?? column.gain];
  [before, after].forEach((levels, k) => { top = Math.max(top, curveOf(levels, gains[k]).top(from, to) * 1.08); });
  const plots = [columnPlot("Uncorrected", before, coverage, from, to, top, gains[0]), columnPlot("This stack", after, coverage, from, to, top, gains[1])];
  $("column-before").innerHTML = plots[0].svg;
  $("column-after").innerHTML = plots[1].svg;
  const [b, a] = plots.map((p) => p.wrong);
  $("column-words").textContent =
    `Pixel ${column.x}, ${column.y} of the image${data.light ? `, which gets ${(100 * column.factor).toPrecision(3)} % of the calibrated light` : ""}: uncorrected ${b.through} layers cured through and ${b.under} undercured; ` +
    `this stack ${a.through} and ${a.under}. ` +
    (plots[1].group > 1 ? `Each band is ${plots[1].group} slices.` : "Each band is one slice.");
  return { column, plots };
}
