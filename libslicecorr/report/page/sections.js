// The three sections, before and after. A cell that is wrong is painted last and never left out.
const view = { row: 0, column: 0, slice: 0, show: "cure" };

const colours = {};
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["right", "through", "under", "pale", "paper", "mark", "fg"]) {
    const hex = style.getPropertyValue("--" + name).trim().replace("#", "");
    const full = hex.length === 3 ? [...hex].map((c) => c + c).join("") : hex;
    colours[name] = [0, 2, 4].map((at) => parseInt(full.slice(at, at + 2), 16));
  }
}
// Liquid in blues, gelled in yellow to red: the step at 1 is what counts.
function doseColour(dose) {
  if (dose < 1) return mix([16, 24, 48], [122, 168, 230], dose);
  return mix([255, 226, 120], [150, 20, 30], Math.min(1, Math.log2(dose) / 3));
}

const sections = data && {
  xz: { across: 0, down: 2, at: (u, v) => [u, view.row, v] },
  // Image rows run against y: the right end is row 0.
  yz: { across: 1, down: 2, at: (u, v) => [view.column, data.cells[1] - 1 - u, v] },
  xy: { across: 0, down: 1, at: (u, v) => [u, v, view.slice] },
};

const lengthUm = (axis) =>
  [data.box[2] - data.box[0], data.box[3] - data.box[1], data.layers][axis] * data.voxelUm[axis];

// Width over height, kept between 1:3 and 3:1 so that flat parts can be seen.
function aspectOf(section) {
  const true_ = lengthUm(section.across) / lengthUm(section.down);
  return { ratio: Math.min(3, Math.max(1 / 3, true_)), true_ };
}

// 1, 2 or 5 times a power of ten, at most a third of the width.
function scaleUm(wide) {
  const most = wide / 3, ten = 10 ** Math.floor(Math.log10(most));
  return (most >= 5 * ten ? 5 : most >= 2 * ten ? 2 : 1) * ten;
}
const lengthWords = (um) => (um >= 1000 ? `${um / 1000} mm` : `${um} um`);
function drawScale(context, width, height, wide) {
  const um = scaleUm(wide), long = um / wide * width;
  const [paper, ink] = [colours.paper, colours.fg].map((c) => `rgb(${c.join()})`);
  context.fillStyle = paper;
  context.font = "16px system-ui, sans-serif";
  const words = lengthWords(um);
  context.globalAlpha = 0.8;
  context.fillRect(4, height - 32, Math.max(long, context.measureText(words).width) + 12, 28);
  context.globalAlpha = 1;
  context.fillStyle = ink;
  context.fillRect(10, height - 12, long, 3);
  context.fillText(words, 10, height - 16);
}

function drawSection(name, side, state, field) {
  const section = sections[name], canvas = $(`${name}-${side ? "after" : "before"}`);
  const nu = data.cells[section.across], nv = data.cells[section.down];
  const { ratio } = aspectOf(section);
  const size = 480;
  const width = Math.round(ratio >= 1 ? size : size * ratio), height = Math.round(ratio >= 1 ? size / ratio : size);
  canvas.width = width;
  canvas.height = height;
  canvas.style.aspectRatio = `${width} / ${height}`;
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  const rgb = (c) => 0xff000000 | (c[2] << 16) | (c[1] << 8) | c[0];
  const plain = { right: rgb(colours.right), pale: rgb(colours.pale), paper: rgb(colours.paper) };
  const hatch = {
    [CURE_THROUGH]: [rgb(colours.through), rgb([142, 21, 22])],
    [UNDERCURE]: [rgb(colours.under), rgb([157, 192, 255])],
  };
  const greys = Array.from({ length: 256 }, (_, g) => rgb([g, g, g]));
  const doses = Array.from({ length: 256 }, (_, c) => rgb(doseColour(doseOf(c)).map(Math.round)));
  const counts = { [CURE_THROUGH]: 0, [UNDERCURE]: 0 };
  const paint = (u, v, colour) => {
    const x0 = Math.floor(u * width / nu), x1 = Math.max(x0 + 1, Math.floor((u + 1) * width / nu));
    const y0 = Math.floor(v * height / nv), y1 = Math.max(y0 + 1, Math.floor((v + 1) * height / nv));
    for (let y = y0; y < y1; ++y) {
      for (let x = x0; x < x1; ++x) pixels[y * width + x] = typeof colour === "number" ? colour : colour(x, y);
    }
  };
  const wrong = [];
  for (let v = 0; v < nv; ++v) {
    for (let u = 0; u < nu; ++u) {
      const cell = section.at(u, v), s = state[side][cellAt(...cell)];
      if (s & CURE_THROUGH) ++counts[CURE_THROUGH];
      if (s & UNDERCURE) ++counts[UNDERCURE];
      if (view.show !== "cure") {
        paint(u, v, (view.show === "dose" ? doses : greys)[field[side][fieldAt(...cell)]]);
      } else if (s & (CURE_THROUGH | UNDERCURE)) {
        wrong.push([u, v, s]);
      } else {
        paint(u, v, s & PRINTED ? (s & GREY && !(s & DESIGNED) ? plain.pale : plain.right) : plain.paper);
      }
    }
  }
  for (const [u, v, s] of wrong) {
    const stripe = (x, y) => {
      const kind = (s & 3) === 3 ? (x + y & 8 ? CURE_THROUGH : UNDERCURE) : s & 3;
      const across = kind === CURE_THROUGH ? x + y : x - y + 4096;
      return hatch[kind][across % 6 < 2 ? 1 : 0];
    };
    paint(u, v, stripe);
  }
  context.putImageData(image, 0, 0);
  // The lines where the other two sections are.
  const place = { xz: [view.column, view.slice], yz: [data.cells[1] - 1 - view.row, view.slice], xy: [view.column, view.row] }[name];
  context.strokeStyle = `rgb(${colours.mark.join()})`;
  context.lineWidth = 1.5;
  context.setLineDash([6, 5]);
  context.beginPath();
  context.moveTo((place[0] + 0.5) * width / nu, 0);
  context.lineTo((place[0] + 0.5) * width / nu, height);
  context.moveTo(0, (place[1] + 0.5) * height / nv);
  context.lineTo(width, (place[1] + 0.5) * height / nv);
  context.stroke();
  context.setLineDash([]);
  drawScale(context, width, height, lengthUm(section.across));
  const words = `${counts[CURE_THROUGH].toLocaleString("en")} cells with cure-through, ${counts[UNDERCURE].toLocaleString("en")} with undercure`;
  canvas.setAttribute("aria-label", `${side ? "this stack" : "uncorrected"}: ${words}`);
  return words;
}

// "x 12.0 to 48.0 mm": image rows run against y, and in the section along y it grows to the right.
function extent(axis, falling) {
  const um = data.voxelUm[axis];
  const from = axis === 2 ? 0 : axis === 0 ? data.box[0] : data.image[1] - data.box[3];
  const to = axis === 2 ? data.layers : axis === 0 ? data.box[2] : data.image[1] - data.box[1];
  const ends = [from, to].map((end) => (end * um / 1000).toFixed(1));
  if (falling) ends.reverse();
  return `${"xyz"[axis]} ${ends.join(" to ")} mm`;
}

async function drawSections() {
  const state = await load.state();
  const field = view.show === "cure" ? null : await load[view.show]();
  readColours();
  let said = "";
  for (const name in sections) {
    const words = [0, 1].map((side) => drawSection(name, side, state, field));
    const { ratio, true_ } = aspectOf(sections[name]);
    const stretched = Math.abs(ratio / true_ - 1) > 0.01;
    const factor = Math.max(ratio / true_, true_ / ratio);
    $(`${name}-words`).textContent =
      `Uncorrected: ${words[0]}. This stack: ${words[1]}. ` +
      `${extent(sections[name].across)} from left to right, ${extent(sections[name].down, name === "xy")} downwards.` +
      (name === "xy" ? " Seen as the image is." : " Platform up.") +
      (stretched ? ` The shorter side is stretched ${factor.toFixed(1)} times.` : "");
    said ||= words[1];
  }
  $("legend").innerHTML = {
    cure: '<b><i class="right"></i>as designed</b><b><i class="through"></i>cured through (red, hatched /)</b>' +
      '<b><i class="under"></i>undercured (blue, hatched \\)</b><b><i class="pale"></i>designed grey</b><b><i class="paper"></i>empty</b>',
    dose: '<b><i class="ramp" style="background:linear-gradient(90deg,rgb(16,24,48),rgb(122,168,230) 40%,rgb(255,226,120) 40%,rgb(150,20,30))"></i>' +
      'dose / critical dose: 0 dark blue, below 1 pale blue (liquid), above 1 yellow (gelled), 8 red</b>',
    grey: '<b><i class="ramp" style="background:linear-gradient(90deg,#000,#fff)"></i>grey level: 0 black to full white</b>',
  }[view.show];
}
