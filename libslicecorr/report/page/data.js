"use strict";
// Reading the data that the page carries. Arrays are deflated and in base 64.
const source = document.getElementById("report-data");
const data = source ? JSON.parse(source.textContent) : null;
const $ = (id) => document.getElementById(id);

async function inflate(text) {
  const chars = atob(text);
  const bytes = new Uint8Array(chars.length);
  for (let i = 0; i < chars.length; ++i) bytes[i] = chars.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const once = (make) => { let kept; return () => (kept ??= make()); };
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
    const skip = () => { for (let n = number(); n > 0; --n) { ++at; while (bytes[at++] > 127); } };
    while (at < bytes.length) {
      starts.push(at);
      number(); number(); skip(); skip();
    }
    return (index) => {
      at = starts[index];
      return { x: number(), y: number(), coverage: runs(), levels: runs() };
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

// Dose at every node, last to first; phi of every slice.
function dosesOf(levels) {
  const phi = levels.map((level) => data.phi[level]);
  const omega = new Array(phi.length + 1).fill(0);
  for (let n = phi.length; n-- > 0;) omega[n] = phi[n] * (1 - data.a) + data.a * omega[n + 1];
  return { phi, omega };
}
