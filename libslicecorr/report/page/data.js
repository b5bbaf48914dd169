// Reading the data that the page carries.
const source = document.getElementById("report-data");
const data = source ? JSON.parse(source.textContent) : null;

const both = (name, after) => once(async () => {
  const pair = await Promise.all(data[name].map(inflate));
  if (after) pair.forEach(after);
  return pair;
});
// Fields are stored as differences from one layer of cells to the next.
const fieldCells = (axis) => Math.ceil(data.cells[axis] / data.fieldEvery);
function undoDifferences(bytes) {
  const layer = fieldCells(0) * fieldCells(1);
  for (let at = layer; at < bytes.length; ++at) bytes[at] += bytes[at - layer];
}
const load = data && {
  state: both("state"),
  dose: both("dose", undoDifferences),
  grey: both("grey", undoDifferences),
  error: both("error"),
  columns: once(async () => {
    const bytes = await inflate(data.columns);
    const light = data.light ? await inflate(data.light.of) : null;
    const starts = [];
    let at = 0;
    const number = () => {
      let value = 0, shift = 0, byte;
      do { byte = bytes[at++]; value += (byte & 127) * 2 ** shift; shift += 7; } while (byte > 127);
      return value;
    };
    const runs = () => {
      const list = [];
      for (let n = number(); n > 0; --n) list.push(bytes[at++], number());
      return list;
    };
    // Intensities of columns that get light from others, on a logarithmic scale.
    const lights = () => {
      const list = [], [least, greatest, steps] = data.spread;
      for (let n = number(); n > 0; --n) {
        const code = number();
        list.push(code ? least * (greatest / least) ** ((code - 1) / steps) : 0, number());
      }
      return list;
    };
    const skipLights = () => { for (let n = number(); n > 0; --n) { number(); number(); } };
    const skip = () => { for (let n = number(); n > 0; --n) { ++at; while (bytes[at++] > 127); } };
    while (at < bytes.length) {
      starts.push(at);
      number(); number(); skip(); skip();
      if (data.spread) { skipLights(); skipLights(); }
    }
    return (index) => {
      at = starts[index];
      const column = { x: number(), y: number(), coverage: runs(), levels: runs(), gain: 1, factor: 1 };
      column.lightBefore = column.lightAfter = null;
      if (data.spread) {
        column.lightBefore = unrolled(lights());
        column.lightAfter = unrolled(lights());
      }
      if (light) {
        column.gain = data.light.gains[light[index]];
        column.factor = data.light.factors[light[index]];
      }
      return column;
    };
  }),
};

const CURE_THROUGH = 1, UNDERCURE = 2, PRINTED = 4, DESIGNED = 8, GREY = 16;
const cellAt = (i, j, k) => (k * data.cells[1] + j) * data.cells[0] + i;
const fieldAt = (i, j, k) => {
  const f = data.fieldEvery;
  return (Math.floor(k / f) * fieldCells(1) + Math.floor(j / f)) * fieldCells(0) + Math.floor(i / f);
};
const doseOf = (code) => (code + 0.5) / (255.5 - code);
const errorOf = (code) => (code ? Math.sign(code - 128) * (2 ** (Math.abs(code - 128) / 7) - 1) / 4 : NaN);

// The slices of a run-length coded column, one value each.
function unrolled(runs) {
  const values = [];
  for (let r = 0; r < runs.length; r += 2) for (let n = runs[r + 1]; n > 0; --n) values.push(runs[r]);
  return values;
}
// As level_of_pixel of the library.
const levelOfPixel = (value) => Math.floor((value * (data.phi.length - 1) + 127) / 255);

// What slices of these levels add up to, slices up to `end` only: phi of every slice, and the dose at the lower end,
// the middle and the upper end of every layer. At the upper end it is Omega of the node, seen from inside the layer.
// `gain`: what uneven light makes of phi at the column's place, or phi itself, slice by slice, where light spreads.
function dosesOf(levels, end = levels.length, gain = 1) {
  const shown = Math.min(end, levels.length), a = data.a;
  const ratio = (n) => (data.ratio ? data.ratio[Math.min(n, data.ratio.length - 1)] : 1);
  const light = (level, n) => (Array.isArray(gain) ? gain[n] ?? 0 : data.phi[level] * gain);
  const phi = levels.map((level, n) => (n < shown ? light(level, n) * ratio(n) : 0));
  let counted = phi;
  const [lower, middle, omega] = [0, 1, 2].map(() => new Array(levels.length + 1).fill(0));
  if (data.kernel) {
    // K_j of the slice j further from the platform; beyond the tables a times the one before.
    const { near, setting } = data.kernel;
    [lower, middle, omega].forEach((dose, place) => {
      const add = (n, j) => (n < shown ? kernelAt(setting[Math.min(n, setting.length - 1)], place, j, levels[n]) * ratio(n) : 0);
      let tail = 0;
      for (let k = levels.length; k-- > 0;) {
        tail = data.kernel.a * (tail + add(k + near, near - 1));
        dose[k] = tail;
        for (let j = 0; j < near; ++j) dose[k] += add(k + j, j);
      }
    });
  } else {
    const root = Math.sqrt(a), [deep, beyond] = data.bath ?? [0, 0];
    // Of a bath that ends: what a slice counts for, less what leaves the bath by then.
    if (deep) counted = phi.map((light, n) => light - beyond * (phi[n + deep] ?? 0));
    for (let n = levels.length; n-- > 0;) {
      lower[n] = data.layerwise ? counted[n] + omega[n + 1] : omega[n + 1];
      middle[n] = data.layerwise ? lower[n] * root : counted[n] * (1 - root) + root * omega[n + 1];
      omega[n] = data.layerwise ? lower[n] * a : counted[n] * (1 - a) + a * omega[n + 1];
    }
  }
  return { phi, counted, lower, middle, omega };
}

// By how much light that the platform sends back multiplies doses.
function returned(zeta) {
  const [share, eta, m] = data.mirror ?? [0, 0, 1];
  return share ? (1 + share * 10 ** (-2 * eta * zeta)) ** m : 1;
}

let kernelValues = null;
const kernelAt = (setting, place, j, level) => {
  const { near, levels } = data.kernel;
  return kernelValues[((setting * 3 + place) * near + j) * levels + level];
};
// The tables of the dose under UV light; false when the page has none.
async function loadKernel() {
  if (!("kernel" in data)) return true;
  if (!data.kernel) return false;
  kernelValues ??= new Float32Array((await inflate(data.kernel.values)).buffer);
  return true;
}
