'use strict';
// Parts on the plate: triangles in the round on a plain canvas, and layers with zoom. Needs no WebGL.

// plate.bin: "SCP1", number of triangles, box in mm, then nine 16-bit places per triangle within the box.
function readTriangles(buffer) {
  const view = new DataView(buffer), n = view.getUint32(4, true);
  if (String.fromCharCode(...new Uint8Array(buffer, 0, 4)) !== 'SCP1' || buffer.byteLength !== 32 + 18 * n) throw new Error('The picture of the plate came damaged.');
  const lower = [0, 1, 2].map((k) => view.getFloat32(8 + 4 * k, true)), upper = [0, 1, 2].map((k) => view.getFloat32(20 + 4 * k, true));
  const places = new Float32Array(9 * n), step = lower.map((l, k) => (upper[k] - l) / 65535);
  const packed = new Uint16Array(buffer, 32, 9 * n);
  for (let i = 0; i < 9 * n; ++i) places[i] = lower[i % 3] + packed[i] * step[i % 3];
  return {n, lower, upper, places};
}

// Parts may be moved over the plate: what is dragged moves, the rest of the canvas turns the view. `moved` is called
// when a part lies elsewhere, `chose` when one is chosen.
class PlateView {
  constructor(canvas, chose, moved) {
    Object.assign(this, {canvas, chose, moved, turn: -0.6, tilt: 0.5, zoom: 1, parts: null, plate: [0, 0], pieces: [], chosen: -1});
    const keys = {ArrowLeft: [0.15, 0], ArrowRight: [-0.15, 0], ArrowUp: [0, 0.12], ArrowDown: [0, -0.12]};
    canvas.addEventListener('keydown', (e) => {
      if (e.ctrlKey || e.metaKey || e.altKey) return;
      if (keys[e.key]) this.move(...keys[e.key]);
      else if (e.key === '+' || e.key === '=') this.scale(1.2);
      else if (e.key === '-') this.scale(1 / 1.2);
      else return;
      e.preventDefault();
    });
    let last = null, held = -1, dragged = false;
    canvas.addEventListener('pointerdown', (e) => {
      last = e;
      held = this.pieceAt(e.offsetX, e.offsetY);
      dragged = false;
      if (held >= 0) this.choose(held);
      canvas.setPointerCapture(e.pointerId);
    });
    canvas.addEventListener('pointermove', (e) => {
      if (!last || last.pointerId !== e.pointerId) return;
      const dx = e.clientX - last.clientX, dy = e.clientY - last.clientY;
      if (held < 0) this.move(dx * -0.01, dy * 0.01);
      else if (this.drag(held, dx, dy)) dragged = true;
      last = e;
    });
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, () => { if (dragged) this.moved(); last = null; held = -1; dragged = false; });
    canvas.addEventListener('wheel', (e) => { e.preventDefault(); this.scale(e.deltaY < 0 ? 1.1 : 1 / 1.1); }, {passive: false});
    new ResizeObserver(() => this.later()).observe(canvas);
  }

  move(turn, tilt) {
    this.turn -= turn;
    this.tilt = Math.max(-1.5, Math.min(1.5, this.tilt + tilt));
    this.later();
  }
  scale(by) { this.zoom = Math.max(0.2, Math.min(20, this.zoom * by)); this.later(); }
  later() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => { this.wanted = false; this.draw(); });
  }
  // `pieces`: for each part its triangles [from, to), the middle of its box and its quarter turns; none: nothing moves.
  show(parts, plate, pieces) {
    const same = pieces.length === this.pieces.length;
    Object.assign(this, {parts, plate, pieces, zoom: same && pieces.length ? this.zoom : 1, chosen: same ? this.chosen : -1});
    this.draw();
  }
  choose(k) { this.chosen = k; this.chose(k); this.later(); }

  // Which part is seen at a place of the canvas; -1: none.
  pieceAt(x, y) {
    if (!this.owner || this.pieces.length === 0) return -1;
    const ratio = this.canvas.width / (this.canvas.clientWidth || 1), px = Math.round(x * ratio), py = Math.round(y * ratio);
    return px >= 0 && py >= 0 && px < this.canvas.width && py < this.canvas.height ? this.owner[py * this.canvas.width + px] - 1 : -1;
  }
  // By so many pixels of the screen, over the plate.
  drag(k, dx, dy) {
    const {right, down} = this.view, ratio = this.canvas.width / (this.canvas.clientWidth || 1), det = right[0] * down[1] - right[1] * down[0];
    // Seen from the side the plate has no depth.
    if (Math.abs(det) < 0.05 * (right[0] * right[0] + right[1] * right[1])) return false;
    this.shift(k, ratio * (dx * down[1] - dy * right[1]) / det, ratio * (dy * right[0] - dx * down[0]) / det);
    return true;
  }
  // By mm.
  shift(k, x, y) {
    const piece = this.pieces[k], {places} = this.parts;
    for (let i = 9 * piece.from; i < 9 * piece.to; i += 3) { places[i] += x; places[i + 1] += y; }
    piece.x_mm += x;
    piece.y_mm += y;
    this.later();
  }
  // By a quarter about z, counter-clockwise from above.
  quarter(k) {
    const piece = this.pieces[k], {places} = this.parts;
    for (let i = 9 * piece.from; i < 9 * piece.to; i += 3) {
      const x = places[i] - piece.x_mm, y = places[i + 1] - piece.y_mm;
      places[i] = piece.x_mm - y;
      places[i + 1] = piece.y_mm + x;
    }
    piece.quarter_turns = (piece.quarter_turns + 1) % 4;
    this.later();
  }

  draw() {
    const {canvas, parts} = this, context = canvas.getContext('2d'), ratio = Math.min(2, window.devicePixelRatio || 1);
    const width = canvas.width = Math.max(200, Math.round(canvas.clientWidth * ratio)), height = canvas.height = Math.max(150, Math.round(canvas.clientHeight * ratio));
    if (!parts) return;
    const {lower, upper} = parts, middle = lower.map((l, k) => (l + upper[k]) / 2);
    const reach = Math.hypot(...lower.map((l, k) => upper[k] - l)) / 2 || 1;
    const unit = 0.42 * Math.min(width, height) / reach * this.zoom;
    const ct = Math.cos(this.turn), st = Math.sin(this.turn), cp = Math.cos(this.tilt), sp = Math.sin(this.tilt);
    // Rows of the turn: to the right, downwards on the screen, towards who looks.
    const right = [ct * unit, -st * unit, 0], down = [-st * sp * unit, -ct * sp * unit, -cp * unit], near = [-st * cp, -ct * cp, sp];
    const at = (p) => {
      const d = [p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]];
      return [width / 2 + d[0] * right[0] + d[1] * right[1], height / 2 + d[0] * down[0] + d[1] * down[1] + d[2] * down[2]];
    };
    this.view = {right, down};
    const style = getComputedStyle(canvas), dark = matchMedia('(prefers-color-scheme: dark)').matches;
    const plate = () => this.drawPlate(context, at, style);
    if (this.tilt >= 0) plate();
    context.drawImage(this.raster(width, height, {middle, right, down, near}, dark ? [126, 170, 220] : [96, 140, 190]), 0, 0);
    if (this.tilt < 0) { context.globalAlpha = 0.5; plate(); context.globalAlpha = 1; }
  }

  // The plate with a line every 10 mm, and a scale in words.
  drawPlate(context, at, style) {
    const [w, d] = this.plate;
    const path = (points) => { context.beginPath(); points.forEach((p, i) => context[i ? 'lineTo' : 'moveTo'](...at(p))); };
    path([[0, 0, 0], [w, 0, 0], [w, d, 0], [0, d, 0]]);
    context.closePath();
    context.fillStyle = style.getPropertyValue('--card');
    context.fill();
    context.strokeStyle = style.getPropertyValue('--line');
    context.lineWidth = 1;
    for (let x = 0; x <= w; x += 10) { path([[x, 0, 0], [x, d, 0]]); context.stroke(); }
    for (let y = 0; y <= d; y += 10) { path([[0, y, 0], [w, y, 0]]); context.stroke(); }
  }

  // Triangles with a depth for each pixel, lit from the upper left behind who looks.
  raster(width, height, {middle, right, down, near}, colour) {
    const {n, places} = this.parts, image = new ImageData(width, height), out = new Uint32Array(image.data.buffer);
    const depth = new Float32Array(width * height).fill(-Infinity), owner = this.owner = new Uint16Array(width * height), plain = colour;
    let piece = 0;
    const light = [0, 1, 2].map((k) => -0.4 * right[k] / (Math.hypot(...right) || 1) - 0.5 * down[k] / (Math.hypot(...down) || 1) + 0.77 * near[k]);
    const x = [0, 0, 0], y = [0, 0, 0], z = [0, 0, 0];
    for (let t = 0, i = 0; t < n; ++t, i += 9) {
      while (piece < this.pieces.length && t >= this.pieces[piece].to) ++piece;
      colour = piece === this.chosen ? [230, 160, 70] : plain;
      for (let c = 0; c < 3; ++c) {
        const a = places[i + 3 * c] - middle[0], b = places[i + 3 * c + 1] - middle[1], d = places[i + 3 * c + 2] - middle[2];
        x[c] = width / 2 + a * right[0] + b * right[1];
        y[c] = height / 2 + a * down[0] + b * down[1] + d * down[2];
        z[c] = a * near[0] + b * near[1] + d * near[2];
      }
      const x0 = Math.max(0, Math.floor(Math.min(x[0], x[1], x[2]))), x1 = Math.min(width - 1, Math.ceil(Math.max(x[0], x[1], x[2])));
      const y0 = Math.max(0, Math.floor(Math.min(y[0], y[1], y[2]))), y1 = Math.min(height - 1, Math.ceil(Math.max(y[0], y[1], y[2])));
      const area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
      if (x0 > x1 || y0 > y1 || Math.abs(area) < 1e-9) continue;
      const u = [places[i + 3] - places[i], places[i + 4] - places[i + 1], places[i + 5] - places[i + 2]];
      const v = [places[i + 6] - places[i], places[i + 7] - places[i + 1], places[i + 8] - places[i + 2]];
      const m = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], length = Math.hypot(...m) || 1;
      // Meshes may have triangles that face the wrong way: both sides are lit alike.
      const side = m[0] * near[0] + m[1] * near[1] + m[2] * near[2] < 0 ? -1 : 1;
      const shade = Math.min(1.25, 0.55 + 0.6 * Math.max(0, side * (m[0] * light[0] + m[1] * light[1] + m[2] * light[2]) / length));
      const pixel = (255 << 24 | Math.min(255, colour[2] * shade) << 16 | Math.min(255, colour[1] * shade) << 8 | Math.min(255, colour[0] * shade)) >>> 0;
      for (let py = y0; py <= y1; ++py) {
        for (let px = x0; px <= x1; ++px) {
          const p = ((x[1] - px) * (y[2] - py) - (x[2] - px) * (y[1] - py)) / area, q = ((x[2] - px) * (y[0] - py) - (x[0] - px) * (y[2] - py)) / area, r = 1 - p - q;
          if (p < -1e-4 || q < -1e-4 || r < -1e-4) continue;
          const deep = p * z[0] + q * z[1] + r * z[2], to = py * width + px;
          if (deep > depth[to]) { depth[to] = deep; out[to] = pixel; owner[to] = piece < this.pieces.length ? piece + 1 : 0; }
        }
      }
    }
    const layer = new OffscreenCanvas(width, height);
    layer.getContext('2d').putImageData(image, 0, 0);
    return layer;
  }
}

// Layers of a study, as images: the slider chooses, wheel, plus and minus zoom, dragging and arrow keys move.
class LayerView {
  constructor(canvas, slider, said) {
    Object.assign(this, {canvas, slider, said, zoom: 1, x: 0, y: 0, image: null, asked: 0});
    slider.addEventListener('input', () => this.go());
    canvas.addEventListener('wheel', (e) => { e.preventDefault(); this.scale(e.deltaY < 0 ? 1.2 : 1 / 1.2); }, {passive: false});
    canvas.addEventListener('keydown', (e) => {
      const step = 30, keys = {ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step]};
      if (e.ctrlKey || e.metaKey || e.altKey) return;
      if (keys[e.key]) this.move(...keys[e.key]);
      else if (e.key === '+' || e.key === '=') this.scale(1.2);
      else if (e.key === '-') this.scale(1 / 1.2);
      else if (e.key === 'PageUp' || e.key === 'PageDown') { slider.value = Number(slider.value) + (e.key === 'PageUp' ? 1 : -1); this.go(); }
      else return;
      e.preventDefault();
    });
    let last = null;
    canvas.addEventListener('pointerdown', (e) => { last = e; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener('pointermove', (e) => {
      if (!last || last.pointerId !== e.pointerId) return;
      this.move(e.clientX - last.clientX, e.clientY - last.clientY);
      last = e;
    });
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, () => { last = null; });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  show(path, facts) {
    Object.assign(this, {path, facts, zoom: 1, x: 0, y: 0});
    this.slider.max = facts.layers - 1;
    this.slider.value = Math.floor(facts.layers / 2);
    return this.go();
  }
  scale(by) { this.zoom = Math.max(1, Math.min(60, this.zoom * by)); this.draw(); }
  move(x, y) { this.x += x; this.y += y; this.draw(); }

  async go() {
    const mine = ++this.asked, n = Number(this.slider.value);
    this.say(n);
    try {
      const image = await createImageBitmap(await (await ask(this.path + '/layers/' + n + '.png')).blob());
      if (mine !== this.asked) return;  // a later layer was asked for
      this.image = image;
      this.draw();
      this.canvas.dataset.layer = n;
    } catch (e) { tell(e); }
  }
  say(n) {
    const f = this.facts;
    this.said.textContent = 'layer ' + count(n + 1) + ' of ' + count(f.layers) + ', ' + ((n + 1) * f.layer_um / 1000).toFixed(3) + ' mm from the platform';
    this.slider.setAttribute('aria-valuetext', this.said.textContent);
  }

  draw() {
    const {canvas, image} = this, context = canvas.getContext('2d'), ratio = Math.min(2, window.devicePixelRatio || 1);
    canvas.width = Math.max(200, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(150, Math.round(canvas.clientHeight * ratio));
    context.fillStyle = '#000';
    context.fillRect(0, 0, canvas.width, canvas.height);
    if (!image) return;
    const high = this.facts.pixel_um[1] / this.facts.pixel_um[0];
    const fit = 0.95 * Math.min(canvas.width / image.width, canvas.height / (image.height * high)) * this.zoom;
    // The picture stays in sight.
    const most = [image.width * fit / 2 / ratio, image.height * high * fit / 2 / ratio];
    this.x = Math.max(-most[0], Math.min(most[0], this.x));
    this.y = Math.max(-most[1], Math.min(most[1], this.y));
    context.imageSmoothingEnabled = fit < 1;
    context.drawImage(image, canvas.width / 2 + this.x * ratio - image.width * fit / 2, canvas.height / 2 + this.y * ratio - image.height * high * fit / 2, image.width * fit, image.height * high * fit);
  }
}
