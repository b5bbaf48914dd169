// The printed cells in the round, drawn cell by cell with a depth buffer on a plain canvas: no WebGL.
// The view is parallel, so every cell has the same outline; it is made once for a view and stamped.
const solid = { side: 1, turn: 0.6, tilt: 0.45, zoom: 1, cells: [null, null], drawing: false };

function errorColour(um) {
  if (Number.isNaN(um)) return [150, 156, 162];
  const t = Math.min(1, Math.log10(1 + Math.abs(um)) / 2.5);
  return mix([150, 190, 140], um > 0 ? [214, 40, 40] : [30, 90, 220], t);
}

// Cured through where no edge is measured: beside grey voxels, or walls.
const throughColour = [176, 60, 110];

// Cells with a free face: place and colour.
async function surface(side) {
  if (solid.cells[side]) return solid.cells[side];
  const state = (await load.state())[side], error = (await load.error())[side];
  const [nx, ny, nz] = data.cells;
  const places = [], colour = [], normals = [];
  const free = (i, j, k) => i < 0 || j < 0 || k < 0 || i >= nx || j >= ny || k >= nz || !(state[cellAt(i, j, k)] & PRINTED);
  const palette = Array.from({ length: 256 }, (_, code) => errorColour(errorOf(code)).map(Math.round));
  for (let k = 0, at = 0; k < nz; ++k) {
    for (let j = 0; j < ny; ++j) {
      for (let i = 0; i < nx; ++i, ++at) {
        if (!(state[at] & PRINTED)) continue;
        const inner = i > 0 && j > 0 && k > 0 && i + 1 < nx && j + 1 < ny && k + 1 < nz &&
          state[at - 1] & state[at + 1] & state[at - nx] & state[at + nx] & state[at - nx * ny] & state[at + nx * ny] & PRINTED;
        if (inner) continue;
        places.push(i, j, k);
        const code = error[fieldAt(i, j, k)];
        colour.push(!code && state[at] & CURE_THROUGH ? throughColour : palette[code]);
        // Outwards: towards the free ones of the neighbours around.
        let n = [0, 0, 0];
        for (let d = 0; d < 27; ++d) {
          const x = d % 3 - 1, y = Math.floor(d / 3) % 3 - 1, z = Math.floor(d / 9) - 1;
          if (free(i + x, j + y, k + z)) { n[0] += x; n[1] += y; n[2] += z; }
        }
        const length = Math.hypot(...n) || 1;
        normals.push(n[0] / length, n[1] / length, n[2] / length);
      }
    }
  }
  return (solid.cells[side] = { places: Float32Array.from(places), normals: Float32Array.from(normals), colour });
}

async function drawSolid() {
  if (solid.drawing) { solid.again = true; return; }
  solid.drawing = true;
  const { places, normals, colour } = await surface(solid.side);
  const canvas = $("solid-canvas"), context = canvas.getContext("2d");
  const scale = Math.min(2, window.devicePixelRatio || 1);
  const width = (canvas.width = Math.max(200, Math.round(canvas.clientWidth * scale)));
  const height = (canvas.height = Math.max(200, Math.round(canvas.clientHeight * scale)));
  const size = [0, 1, 2].map((axis) => data.step[axis] * data.voxelUm[axis]);
  const half = [0, 1, 2].map((axis) => data.cells[axis] * size[axis] / 2);
  const unit = 0.46 * Math.min(width, height) / Math.hypot(...half) * solid.zoom;
  // x right, image rows towards the viewer, z down from the platform.
  const ct = Math.cos(solid.turn), st = Math.sin(solid.turn), cp = Math.cos(solid.tilt), sp = Math.sin(solid.tilt);
  const toView = [[ct, st * sp, st * cp], [-st, ct * sp, ct * cp], [0, cp, -sp]];
  const axes = toView.map((v, axis) => v.map((c) => c * unit * size[axis]));
  const light = toView.map((v) => -0.35 * v[0] - 0.5 * v[1] + 0.79 * v[2]);
  // Outline of a cell: its three faces that look this way.
  const stamp = [];
  const reach = axes.map((_, c) => (Math.abs(axes[0][c]) + Math.abs(axes[1][c]) + Math.abs(axes[2][c])) / 2 + 1);
  const faces = [0, 1, 2].map((axis) => {
    const u = axes[(axis + 1) % 3], v = axes[(axis + 2) % 3], sign = axes[axis][2] >= 0 ? 0.5 : -0.5;
    return { u, v, middle: axes[axis].map((c) => c * sign), cross: u[0] * v[1] - u[1] * v[0] };
  });
  for (let y = -Math.ceil(reach[1]); y <= reach[1]; ++y) {
    for (let x = -Math.ceil(reach[0]); x <= reach[0]; ++x) {
      let best = null;
      for (const f of faces) {
        if (Math.abs(f.cross) < 1e-9) continue;
        const px = x - f.middle[0], py = y - f.middle[1];
        const p = (px * f.v[1] - py * f.v[0]) / f.cross, q = (f.u[0] * py - f.u[1] * px) / f.cross;
        // Half a picture pixel more than the face, so that rounding leaves no holes.
        const mp = 0.5 + 0.6 / Math.hypot(f.u[0], f.u[1]), mq = 0.5 + 0.6 / Math.hypot(f.v[0], f.v[1]);
        if (Math.abs(p) > mp || Math.abs(q) > mq) continue;
        const over = Math.max(Math.abs(p), Math.abs(q));
        if (!best || over < best.over) best = { over, depth: f.middle[2] + p * f.u[2] + q * f.v[2] };
      }
      if (best) stamp.push([x, y, best.depth]);
    }
  }
  if (!stamp.length) stamp.push([0, 0, 0]);
  const image = context.createImageData(width, height), out = image.data;
  const depth = new Float32Array(width * height).fill(-Infinity);
  const cx = width / 2, cy = height / 2;
  for (let n = 0, at = 0; n < colour.length; ++n, at += 3) {
    const dx = places[at] + 0.5 - data.cells[0] / 2, dy = places[at + 1] + 0.5 - data.cells[1] / 2, dz = places[at + 2] + 0.5 - data.cells[2] / 2;
    const px = Math.round(cx + dx * axes[0][0] + dy * axes[1][0] + dz * axes[2][0]);
    const py = Math.round(cy + dx * axes[0][1] + dy * axes[1][1] + dz * axes[2][1]);
    const pz = dx * axes[0][2] + dy * axes[1][2] + dz * axes[2][2];
    const c = colour[n];
    // Light from the upper left, behind the viewer.
    const facing = normals[at] * light[0] + normals[at + 1] * light[1] + normals[at + 2] * light[2];
    const shade = 0.66 + 0.44 * facing;
    for (const [sx, sy, sz] of stamp) {
      const x = px + sx, y = py + sy;
      if (x < 0 || y < 0 || x >= width || y >= height) continue;
      const to = y * width + x;
      if (pz + sz <= depth[to]) continue;
      depth[to] = pz + sz;
      const o = to * 4;
      out[o] = Math.min(255, c[0] * shade);
      out[o + 1] = Math.min(255, c[1] * shade);
      out[o + 2] = Math.min(255, c[2] * shade);
      out[o + 3] = 255;
    }
  }
  context.putImageData(image, 0, 0);
  $("solid-words").textContent = colour.length
    ? `${colour.length} cells of the surface. The platform is at the top. Drag, or use the arrow keys and + and −.`
    : "Nothing prints.";
  solid.drawing = false;
  if (solid.again) { solid.again = false; requestAnimationFrame(drawSolid); }
}

function turnSolid(how) {
  const steps = { left: [0.15, 0], right: [-0.15, 0], up: [0, -0.12], down: [0, 0.12] }[how];
  if (steps) {
    solid.turn += steps[0];
    solid.tilt = Math.max(-1.5, Math.min(1.5, solid.tilt + steps[1]));
  } else {
    solid.zoom = Math.max(0.5, Math.min(8, solid.zoom * (how === "in" ? 1.2 : 1 / 1.2)));
  }
  return drawSolid();
}

function startSolid() {
  const canvas = $("solid-canvas");
  const swatch = (um) => `<i style="background:rgb(${errorColour(um).map(Math.round).join()})"></i>`;
  $("solid-legend").innerHTML =
    `<b>${swatch(NaN)}no edge here (a wall)</b><b>${swatch(0)}edge right</b><b>${swatch(20)}20 um too far</b><b>${swatch(300)}300 um too far (red)</b>` +
    `<b>${swatch(-20)}20 um short</b><b>${swatch(-300)}300 um short (blue)</b>` +
    `<b><i style="background:rgb(${throughColour.join()})"></i>cured through, no edge measured (purple)</b>`;
  const keys = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "in", "=": "in", "-": "out" };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    turnSolid(keys[event.key]);
  });
  for (const button of document.querySelectorAll("[data-turn]")) button.addEventListener("click", () => turnSolid(button.dataset.turn));
  let last = null;
  canvas.addEventListener("pointerdown", (event) => { last = event; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    if (!last || last.pointerId !== event.pointerId) return;
    solid.turn -= (event.clientX - last.clientX) * 0.01;
    solid.tilt = Math.max(-1.5, Math.min(1.5, solid.tilt + (event.clientY - last.clientY) * 0.01));
    last = event;
    drawSolid();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { last = null; });
  for (const radio of document.querySelectorAll("input[name=solid]")) {
    radio.addEventListener("change", () => { solid.side = +radio.value; drawSolid(); });
  }
}
