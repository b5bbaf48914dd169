// Cells in the round, drawn one by one with a depth buffer on a plain canvas: no WebGL.
// The view is parallel, so every cell has the same outline; it is made once for a view and stamped.

// The filled cells with a free face: places, normals outwards, and colours. `filled` has a number for each cell, x
// fastest, 0 where there is nothing; `colourOf(at)` gives red, green, blue of a cell.
function surfaceOf([nx, ny, nz], filled, colourOf) {
  const places = [], colour = [], normals = [];
  const free = (i, j, k) => i < 0 || j < 0 || k < 0 || i >= nx || j >= ny || k >= nz || !filled[(k * ny + j) * nx + i];
  for (let k = 0, at = 0; k < nz; ++k) {
    for (let j = 0; j < ny; ++j) {
      for (let i = 0; i < nx; ++i, ++at) {
        if (!filled[at]) continue;
        const inner = i > 0 && j > 0 && k > 0 && i + 1 < nx && j + 1 < ny && k + 1 < nz &&
          filled[at - 1] && filled[at + 1] && filled[at - nx] && filled[at + nx] && filled[at - nx * ny] && filled[at + nx * ny];
        if (inner) continue;
        places.push(i, j, k);
        colour.push(colourOf(at));
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
  return { places: Float32Array.from(places), normals: Float32Array.from(normals), colour };
}

// `counts` and `size`: cells along each side, and how large one is. x to the right; y towards the viewer and z down,
// as images lie that hang from a platform; or `up`: z up.
class RoundView {
  constructor(canvas, counts, size, up = false) {
    Object.assign(this, { canvas, counts, size, up, turn: 0.6, tilt: 0.45, zoom: 1 });
  }

  draw({ places, normals, colour }) {
    const { canvas, counts, size } = this, context = canvas.getContext("2d");
    const scale = Math.min(2, window.devicePixelRatio || 1);
    const width = (canvas.width = Math.max(200, Math.round(canvas.clientWidth * scale)));
    const height = (canvas.height = Math.max(200, Math.round(canvas.clientHeight * scale)));
    const half = [0, 1, 2].map((axis) => counts[axis] * size[axis] / 2);
    const unit = 0.46 * Math.min(width, height) / Math.hypot(...half) * this.zoom;
    const ct = Math.cos(this.turn), st = Math.sin(this.turn), cp = Math.cos(this.tilt), sp = Math.sin(this.tilt);
    const hanging = [[ct, st * sp, st * cp], [-st, ct * sp, ct * cp], [0, cp, -sp]];
    const toView = this.up ? hanging.map((v, axis) => (axis ? v.map((c) => -c) : v)) : hanging;
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
      const dx = places[at] + 0.5 - counts[0] / 2, dy = places[at + 1] + 0.5 - counts[1] / 2, dz = places[at + 2] + 0.5 - counts[2] / 2;
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
  }

  turnBy(how) {
    const steps = { left: [0.15, 0], right: [-0.15, 0], up: [0, -0.12], down: [0, 0.12] }[how];
    if (steps) {
      this.turn += steps[0];
      this.tilt = Math.max(-1.5, Math.min(1.5, this.tilt + steps[1]));
    } else {
      this.zoom = Math.max(0.5, Math.min(8, this.zoom * (how === "in" ? 1.2 : 1 / 1.2)));
    }
  }

  // Arrow keys, plus and minus, buttons (made here, in #turns), dragging and touch: `draw` is called after each.
  listen(draw) {
    const canvas = this.canvas;
    const keys = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "in", "=": "in", "-": "out" };
    canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.turnBy(keys[event.key]);
      draw();
    });
    for (const [how, sign, words] of [["left", "←", "turn left"], ["right", "→", "turn right"], ["up", "↑", "turn up"],
      ["down", "↓", "turn down"], ["in", "+", "nearer"], ["out", "−", "further"]]) {
      const button = document.createElement("button");
      button.type = "button";
      button.dataset.turn = how;
      button.textContent = sign;
      button.setAttribute("aria-label", words);
      button.addEventListener("click", () => { this.turnBy(how); draw(); });
      document.getElementById("turns").append(button);
    }
    let last = null;
    canvas.addEventListener("pointerdown", (event) => { last = event; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointermove", (event) => {
      if (!last || last.pointerId !== event.pointerId) return;
      this.turn -= (event.clientX - last.clientX) * 0.01;
      this.tilt = Math.max(-1.5, Math.min(1.5, this.tilt + (event.clientY - last.clientY) * 0.01));
      last = event;
      draw();
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { last = null; });
  }
}
