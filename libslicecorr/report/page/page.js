// Controls, and a test of themselves: with #selftest in the address the page tries all of them.
const voxelOf = (axis, cell) => {
  const first = cell * data.step[axis] + (axis < 2 ? data.box[axis] : 0);
  const last = Math.min(first + data.step[axis], axis < 2 ? data.box[axis + 2] : data.layers) - 1;
  return { first, last, words: first === last ? `${first}` : `${first} to ${last}` };
};
const controls = { column: 0, row: 1, slice: 2 };

function sayPlaces() {
  for (const name in controls) {
    const axis = controls[name], { first, last, words } = voxelOf(axis, view[name]);
    const middle = (first + last + 1) / 2;
    const um = axis === 2 && data.nodesUm ? (data.nodesUm[first] + data.nodesUm[last + 1]) / 2
      : (axis === 1 ? data.image[1] - middle : middle) * data.voxelUm[axis];
    const mm = um / 1000;
    const text = `${words}, ${"xyz"[axis]} = ${mm.toFixed(2)} mm`;
    $(name).value = view[name];
    $(name).setAttribute("aria-valuetext", text);
    $(name + "-out").textContent = text;
  }
}

let waiting = null;
// Many events in a row make one drawing.
function redraw() {
  sayPlaces();
  return (waiting ??= new Promise((done) => setTimeout(async () => {
    waiting = null;
    await drawSections();
    await drawColumn();
    done();
  }, 0)));
}

function moveTo(cells) {
  for (const name in cells) {
    const most = data.cells[controls[name]] - 1;
    view[name] = Math.max(0, Math.min(most, cells[name]));
  }
  return redraw();
}
const cellOfPixel = (axis, value) => Math.floor((value - (axis < 2 ? data.box[axis] : 0)) / data.step[axis]);

// The cell that is furthest wrong, and why: a body that hangs on nothing comes first, wrong voxels come before height errors, and where all are alike the
// one with most wrong neighbours, which is what a person would look at.
async function worstPlace(side) {
  const loose = side ? document.querySelector("tr.loose button.go") : null;
  if (loose) {
    const [i, j, k] = [loose.dataset.x, loose.dataset.y, loose.dataset.n].map((value, axis) => cellOfPixel(axis, +value));
    return { i, j, k, loose: loose.closest("tr").querySelector("th").textContent };
  }
  const state = (await load.state())[side], error = (await load.error())[side];
  let best = null;
  for (let k = 0, at = 0; k < data.cells[2]; ++k) {
    for (let j = 0; j < data.cells[1]; ++j) {
      for (let i = 0; i < data.cells[0]; ++i, ++at) {
        const wrong = state[at] & (CURE_THROUGH | UNDERCURE);
        const um = Math.abs(errorOf(error[at])) || 0;
        if (!wrong && !um) continue;
        const weight = (wrong ? 1e6 : 0) + um;
        if (best && weight < best.weight) continue;
        let around = 0;
        if (wrong) {
          for (let b = Math.max(0, j - 2); b <= Math.min(data.cells[1] - 1, j + 2); ++b) {
            for (let a = Math.max(0, i - 2); a <= Math.min(data.cells[0] - 1, i + 2); ++a) {
              around += state[cellAt(a, b, k)] & wrong ? 1 : 0;
            }
          }
        }
        if (!best || weight > best.weight || around > best.around) best = { i, j, k, wrong, um: errorOf(error[at]), weight, around };
      }
    }
  }
  return best;
}
function wordsOfPlace(side, place) {
  const whose = side ? "This stack" : "Uncorrected";
  if (!place) return `${whose}: no voxel is wrong and no edge is off.`;
  const what = place.loose ? `a body ${place.loose} here` : place.wrong & CURE_THROUGH ? "light cures a gap through here" : place.wrong ? "a feature stays liquid here"
    : `the largest height error, ${place.um > 0 ? "+" : "−"}${Math.abs(place.um).toPrecision(2)} um (${place.um > 0 ? "reaches too far" : "stays behind"})`;
  const at = [["column", 0, place.i], ["row", 1, place.j], ["slice", 2, place.k]].map(([name, axis, cell]) => `${name} ${voxelOf(axis, cell).words}`);
  return `${whose}: ${what}. Image ${at.join(", ")}.`;
}
async function goToWorst(side) {
  const place = await worstPlace(side);
  $("worst-words").textContent = wordsOfPlace(side, place);
  if (place) await moveTo({ column: place.i, row: place.j, slice: place.k });
}

function startControls() {
  $("worst-after").addEventListener("click", () => goToWorst(1));
  $("worst-before").addEventListener("click", () => goToWorst(0));
  for (const name in controls) {
    const slider = $(name);
    slider.min = 0;
    slider.max = data.cells[controls[name]] - 1;
    slider.step = 1;
    slider.addEventListener("input", () => moveTo({ [name]: +slider.value }));
  }
  for (const radio of document.querySelectorAll("input[name=show]")) {
    radio.addEventListener("change", () => { view.show = radio.value; redraw(); });
  }
  for (const radio of document.querySelectorAll("input[name=range]")) radio.addEventListener("change", drawColumn);
  for (const name in sections) {
    const section = sections[name];
    for (const side of ["before", "after"]) {
      $(`${name}-${side}`).addEventListener("click", (event) => {
        const box = event.currentTarget.getBoundingClientRect();
        const part = (offset, length, axis) => Math.max(0, Math.min(data.cells[axis] - 1, Math.floor(offset / length * data.cells[axis])));
        const u = part(event.clientX - box.left, box.width, section.across);
        const v = part(event.clientY - box.top, box.height, section.down);
        const [i, j, k] = section.at(u, v);
        moveTo({ column: i, row: j, slice: k });
      });
    }
  }
  for (const button of document.querySelectorAll("button.go")) {
    button.hidden = false;
    button.addEventListener("click", () => {
      moveTo({ column: cellOfPixel(0, +button.dataset.x), row: cellOfPixel(1, +button.dataset.y), slice: cellOfPixel(2, +button.dataset.n) });
      $("explorer").scrollIntoView();
      $("slice").focus();
    });
  }
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  scheme.addEventListener("change", () => { drawSections(); drawSolid(); });
  window.addEventListener("beforeprint", drawSections);
  window.addEventListener("afterprint", drawSections);
  window.addEventListener("resize", drawSolid);
}

async function selftest(firstPicture) {
  const result = { firstPictureMs: Math.round(firstPicture), checks: {} };
  const check = (name, value) => { result.checks[name] = !!value; };
  const picture = (id) => $(id).toDataURL();
  try {
    for (const [name, canvas] of [["row", "xz-before"], ["column", "yz-before"], ["slice", "xy-before"]]) {
      const old = $(name).value;
      const changed = [];
      for (const value of [0, Math.floor($(name).max / 2), $(name).max]) {
        $(name).value = value;
        $(name).dispatchEvent(new Event("input"));
        await redraw();
        changed.push(picture(canvas));
      }
      check(`slider ${name} is labelled`, $(name).labels.length === 1 && $(name).getAttribute("aria-valuetext"));
      check(`slider ${name} moves`, view[name] === +$(name).max);
      check(`slider ${name} draws`, changed.every((url) => url.length > 200));
      $(name).value = old;
      $(name).dispatchEvent(new Event("input"));
      await redraw();
    }
    const seen = [];
    for (const radio of document.querySelectorAll("input[name=show]")) {
      radio.click();
      await redraw();
      seen.push(picture("xz-after"));
      check(`legend of ${radio.value} has words`, $("legend").textContent.length > 10);
    }
    check("cure, dose and grey differ", new Set(seen).size === 3);
    document.querySelector("input[name=show][value=cure]").click();
    const canvas = $("xz-before"), box = canvas.getBoundingClientRect();
    canvas.dispatchEvent(new MouseEvent("click", { clientX: box.left + box.width * 0.3, clientY: box.top + box.height * 0.6, bubbles: true }));
    await redraw();
    check("click moves the column", Math.abs(view.column - data.cells[0] * 0.3) <= 1 + data.cells[0] / box.width);
    check("click moves the slice", Math.abs(view.slice - data.cells[2] * 0.6) <= 1 + data.cells[2] / box.height);
    const { column, plots } = await drawColumn();
    check("plots have bands", plots.every((p) => p.bands > 1));
    const levels = unrolled(column.levels), curve = curveOf(levels, column.lightAfter ?? column.gain);
    let worst = 0;
    for (let k = 0; k < levels.length; k += Math.max(1, Math.floor(levels.length / 50))) {
      let sum = 0;
      for (let n = k; n < levels.length; ++n) sum += curve.add(n, k);
      worst = Math.max(worst, Math.abs(sum - curve.omega[k]));
    }
    check("contributions sum to the dose", worst < 1e-9);
    document.querySelector("input[name=range][value=near]").click();
    const near = await drawColumn();
    check("near range has one slice per band", near.plots[1].group === 1 || levels.length < 40);
    document.querySelector("input[name=range][value=all]").click();
    await drawColumn();
    result.column = { x: column.x, y: column.y, levels, dose: curve.omega };
    const round = [];
    const start = performance.now();
    await drawSolid();
    round.push(picture("solid-canvas"));
    $("solid-canvas").dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
    await new Promise((done) => setTimeout(done, 50));
    round.push(picture("solid-canvas"));
    document.querySelector("[data-turn=in]").click();
    await new Promise((done) => setTimeout(done, 50));
    round.push(picture("solid-canvas"));
    result.solidMs = Math.round((performance.now() - start - 100) / 3);
    check("the solid turns and comes nearer", new Set(round).size === 3);
    const go = document.querySelector("button.go");
    if (go) {
      go.closest("details")?.setAttribute("open", "");
      go.click();
      await redraw();
      check("show goes to the feature", view.row === cellOfPixel(1, +go.dataset.y) && document.activeElement === $("slice"));
    }
    check("no sideways scroll", document.documentElement.scrollWidth <= document.documentElement.clientWidth);
    check("buttons and fields are named", [...document.querySelectorAll("button, input")].every((e) =>
      (e.labels && e.labels.length) || e.textContent.trim() || e.getAttribute("aria-label")));
    await goToWorst(0);
    check("the worst place is told", $("worst-words").textContent.startsWith("Uncorrected: "));
    check("states read", (await load.state()).every((s) => s.length === data.cells[0] * data.cells[1] * data.cells[2]));
    result.wrong = (await load.state()).map((s) => [s.reduce((n, v) => n + (v & CURE_THROUGH), 0), s.reduce((n, v) => n + (v >> 1 & 1), 0)]);
    result.ok = Object.values(result.checks).every(Boolean);
  } catch (error) {
    result.ok = false;
    result.error = `${error} ${error.stack}`;
  }
  const out = document.createElement("pre");
  out.id = "selftest";
  out.textContent = JSON.stringify(result);
  document.body.append(out);
}

async function start() {
  if (typeof DecompressionStream === "undefined") {
    $("explorer").hidden = false;
    $("explorer").innerHTML = "<p>This browser is too old for the moving pictures; the figures and still pictures are all here.</p>";
    return;
  }
  $("explorer").hidden = false;
  const [sx, sy, sz] = data.step;
  $("explorer-note").textContent = sx * sy * sz === 1
    ? "Every cell is one voxel."
    : `Every cell is ${sx} x ${sy} pixels and ${sz} slices; it is marked wrong when any voxel in it is. Dose and grey are those of one pixel in it, the one with most wrong voxels.`;
  view.row = cellOfPixel(1, data.start[1]);
  view.column = cellOfPixel(0, data.start[0]);
  view.slice = cellOfPixel(2, data.start[2]);
  // What is wrong tells more than the middle does: of this stack, else of what it corrects.
  for (const side of [1, 0]) {
    const place = await worstPlace(side);
    if (!place?.wrong && !place?.loose) continue;
    [view.column, view.row, view.slice] = [place.i, place.j, place.k];
    $("worst-words").textContent = `Opened at the worst place. ${wordsOfPlace(side, place)}`;
    break;
  }
  startControls();
  startSolid();
  sayPlaces();
  await drawSections();
  const firstPicture = performance.now();
  await drawColumn();
  await drawSolid();
  document.documentElement.dataset.ready = "yes";
  if (location.hash === "#selftest") await selftest(firstPicture);
}
if (data) start();
