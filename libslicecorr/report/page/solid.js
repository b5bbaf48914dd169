// The printed cells in the round.
const solid = { side: 1, view: null, cells: [null, null], drawing: false };

function errorColour(um) {
  if (Number.isNaN(um)) return [150, 156, 162];
  const t = Math.min(1, Math.log10(1 + Math.abs(um)) / 2.5);
  return mix([150, 190, 140], um > 0 ? [214, 40, 40] : [30, 90, 220], t);
}

// Cured through where no edge is measured: beside grey voxels, or walls.
const throughColour = [176, 60, 110];

async function surface(side) {
  if (solid.cells[side]) return solid.cells[side];
  const state = (await load.state())[side], error = (await load.error())[side];
  const [nx, ny] = data.cells;
  const palette = Array.from({ length: 256 }, (_, code) => errorColour(errorOf(code)).map(Math.round));
  const colourOf = (at) => {
    const code = error[fieldAt(at % nx, Math.floor(at / nx) % ny, Math.floor(at / (nx * ny)))];
    return !code && state[at] & CURE_THROUGH ? throughColour : palette[code];
  };
  return (solid.cells[side] = surfaceOf(data.cells, state.map((s) => s & PRINTED), colourOf));
}

async function drawSolid() {
  if (solid.drawing) { solid.again = true; return; }
  solid.drawing = true;
  const cells = await surface(solid.side);
  solid.view.draw(cells);
  $("solid-words").textContent = cells.colour.length
    ? `${cells.colour.length} cells of the surface. The platform is at the top. Drag, or use the arrow keys and + and −.`
    : "Nothing prints.";
  solid.drawing = false;
  if (solid.again) { solid.again = false; requestAnimationFrame(drawSolid); }
}

function startSolid() {
  const swatch = (um) => `<i style="background:rgb(${errorColour(um).map(Math.round).join()})"></i>`;
  $("solid-legend").innerHTML =
    `<b>${swatch(NaN)}no edge here (a wall)</b><b>${swatch(0)}edge right</b><b>${swatch(20)}20 um too far</b><b>${swatch(300)}300 um too far (red)</b>` +
    `<b>${swatch(-20)}20 um short</b><b>${swatch(-300)}300 um short (blue)</b>` +
    `<b><i style="background:rgb(${throughColour.join()})"></i>cured through, no edge measured (purple)</b>`;
  solid.view = new RoundView($("solid-canvas"), data.cells, [0, 1, 2].map((axis) => data.step[axis] * data.voxelUm[axis]));
  solid.view.listen(drawSolid);
  for (const radio of document.querySelectorAll("input[name=solid]")) {
    radio.addEventListener("change", () => { solid.side = +radio.value; drawSolid(); });
  }
}
