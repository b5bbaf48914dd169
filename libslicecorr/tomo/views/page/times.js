// What has gelled when. A cell has the hundredth of the print's time at which it gels, 0: not up to 150 %.
const data = JSON.parse($("tomo-data").textContent);
const EMPTY = 0, PART = 1, NEITHER = 2, INSERT = 3;
const round = { view: null, time: 100, colour: "right", liquid: false };

const load = once(async () => {
  const [time, kind] = await Promise.all([data.time, data.kind].map(inflate));
  // Times are differences from one layer of cells to the next.
  const layer = data.cells[0] * data.cells[1];
  for (let at = layer; at < time.length; ++at) time[at] += time[at - layer];
  return { time, kind };
});

const shades = { right: [150, 156, 162], gelled: [214, 48, 49], neither: [205, 209, 213], liquid: [110, 155, 235], paleLiquid: [222, 226, 230], insert: [90, 78, 66] };
// From dark violet, early, over green to yellow at the end of the print; red after it.
const steps = [[123, 63, 160], [63, 111, 181], [43, 143, 156], [42, 168, 132], [160, 218, 57], [253, 231, 37]];
function whenColour(time) {
  if (time > 100) return mix([230, 120, 30], [150, 20, 30], (time - 100) / 50);
  const from = data.first, at = Math.max(0, time - from) / Math.max(1, 100 - from) * (steps.length - 1);
  const i = Math.min(steps.length - 2, Math.floor(at));
  return mix(steps[i], steps[i + 1], at - i);
}

// Blue, but not where blue says when.
const liquidColour = () => (round.colour === "when" ? shades.paleLiquid : shades.liquid);

function timeInWords(percent) {
  const s = percent / 100 * data.time_s, turn = percent / 100 * data.turns;
  const clock = s < 60 ? `${s.toFixed(1)} s` : `${Math.floor(s / 60)} min ${String(Math.floor(s % 60)).padStart(2, "0")} s`;
  const turns = data.turns ? `, ${turn.toFixed(turn < 10 ? 1 : 0)} of ${data.turns} turn${data.turns === 1 ? "" : "s"}` : "";
  return `${percent} %: ${clock}${turns}` +
    (percent > 100 ? ", longer than the print takes" : "");
}

async function countAt(percent) {
  const { time, kind } = await load();
  const n = { part: 0, parts: 0, empty: 0 };
  for (let at = 0; at < time.length; ++at) {
    const gels = time[at] && time[at] <= percent;
    if (kind[at] === PART) { ++n.parts; if (gels) ++n.part; }
    if (kind[at] === EMPTY && gels) ++n.empty;
  }
  return n;
}

async function drawRound() {
  if (round.drawing) { round.again = true; return; }
  round.drawing = true;
  const { time, kind } = await load(), percent = round.time;
  const filled = new Uint8Array(time.length);
  for (let at = 0; at < time.length; ++at) {
    filled[at] = kind[at] === INSERT || (time[at] && time[at] <= percent) || (round.liquid && kind[at] === PART) ? 1 : 0;
  }
  const palette = Array.from({ length: 256 }, (_, t) => whenColour(t).map(Math.round));
  const cells = surfaceOf(data.cells, filled, (at) => {
    if (kind[at] === INSERT) return shades.insert;
    if (!time[at] || time[at] > percent) return liquidColour();
    if (round.colour === "when") return palette[time[at]];
    return kind[at] === PART ? shades.right : kind[at] === EMPTY ? shades.gelled : shades.neither;
  });
  round.view.draw(cells);
  const n = await countAt(percent), what = data.every === 1 ? "voxels" : "cells";
  $("round-words").textContent =
    `At ${timeInWords(percent)}: ${n.part} of ${n.parts} ${what} of the part have gelled (${(100 * n.part / Math.max(1, n.parts)).toFixed(1)} %), ` +
    `${n.empty} of void. z is up. Drag, or use the arrow keys and + and −.`;
  round.drawing = false;
  if (round.again) { round.again = false; requestAnimationFrame(drawRound); }
}

function legend() {
  const swatch = (c, words) => `<b><i style="background:rgb(${c.map(Math.round).join()})"></i>${words}</b>`;
  const at = [data.first, Math.round((data.first + 100) / 2), 100, 125, 150];
  $("round-legend").innerHTML = (round.colour === "when"
    ? at.map((t) => swatch(whenColour(t), `gels at ${t} %`)).join("")
    : swatch(shades.right, "part, gelled") + swatch(shades.gelled, "void, gelled (red)") + swatch(shades.neither, "grey voxel, gelled: neither part nor void")) +
    (round.liquid ? swatch(liquidColour(), round.colour === "when" ? "part, still liquid (pale)" : "part, still liquid (blue)") : "") + (data.insert ? swatch(shades.insert, "insert") : "");
}

function showTime() {
  $("time").value = round.time;
  $("time-out").textContent = timeInWords(round.time);
  $("time").setAttribute("aria-valuetext", timeInWords(round.time));
}

function startRound() {
  round.view = new RoundView($("solid-canvas"), data.cells, [1, 1, 1].map((n) => n * data.cell_mm), true);
  round.view.listen(drawRound);
  $("time").addEventListener("input", () => { round.time = +$("time").value; showTime(); drawRound(); });
  $("liquid").addEventListener("change", () => { round.liquid = $("liquid").checked; legend(); drawRound(); });
  for (const radio of document.querySelectorAll("input[name=colour]")) {
    radio.addEventListener("change", () => { round.colour = radio.value; legend(); drawRound(); });
  }
  window.addEventListener("resize", drawRound);
}

async function selftest() {
  const result = { checks: {}, counts: {} };
  const check = (name, value) => { result.checks[name] = !!value; };
  const settled = async () => {
    do await new Promise((done) => setTimeout(done, 20)); while (round.drawing);
    return $("solid-canvas").toDataURL();
  };
  try {
    const start = performance.now(), seen = [];
    for (const percent of [0, data.first, 100, 150]) {
      $("time").value = percent;
      $("time").dispatchEvent(new Event("input"));
      seen.push(await settled());
      check(`words at ${percent} %`, $("round-words").textContent.includes(`At ${percent} %`) && $("time-out").textContent.includes(data.turns ? "turn" : " s"));
      result.counts[percent] = await countAt(percent);
    }
    result.drawMs = Math.round((performance.now() - start) / 4);
    check("the slider changes the picture", seen[0] !== seen[2]);
    check("slider is labelled", $("time").labels.length === 1 && $("time").getAttribute("aria-valuetext"));
    $("time").value = 100;
    $("time").dispatchEvent(new Event("input"));
    const end = await settled();
    for (const how of ["left", "in"]) document.querySelector(`[data-turn=${how}]`).click();
    const turned = await settled();
    check("it turns and comes nearer", turned !== end);
    $("solid-canvas").dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowUp" }));
    check("keys turn it", (await settled()) !== turned);
    document.querySelector("input[name=colour][value=when]").click();
    check("colours by time differ", (await settled()) !== turned && $("round-legend").textContent.includes("gels at 100 %"));
    $("time").value = 0;
    $("time").dispatchEvent(new Event("input"));
    const none = await settled();
    $("liquid").click();
    check("liquid part is shown", (await settled()) !== none && $("round-legend").textContent.includes("liquid"));
    check("no sideways scroll", document.documentElement.scrollWidth <= document.documentElement.clientWidth);
    check("buttons and fields are named", [...document.querySelectorAll("button, input")].every((e) =>
      (e.labels && e.labels.length) || e.textContent.trim() || e.getAttribute("aria-label")));
    check("pictures have words", [...document.querySelectorAll("img, svg[role=img]")].every((e) => (e.alt || e.getAttribute("aria-label") || "").length > 5));
    const { time, kind } = await load();
    check("cells read", time.length === kind.length && time.length === data.cells[0] * data.cells[1] * data.cells[2]);
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

// So near that the part fills the picture, whatever of void is kept around it.
async function comeNear() {
  const { kind } = await load(), [nx, ny] = data.cells;
  const low = [...data.cells], high = [-1, -1, -1];
  for (let at = 0; at < kind.length; ++at) {
    if (kind[at] !== PART) continue;
    [at % nx, Math.floor(at / nx) % ny, Math.floor(at / (nx * ny))].forEach((c, axis) => {
      low[axis] = Math.min(low[axis], c);
      high[axis] = Math.max(high[axis], c);
    });
  }
  if (high[0] < 0) return;
  // About the middle of all cells, about which it turns.
  const reach = data.cells.map((n, axis) => Math.max(Math.abs(low[axis] - n / 2), Math.abs(high[axis] + 1 - n / 2)));
  round.view.zoom = Math.min(4, Math.hypot(...data.cells) / 2 / Math.hypot(...reach));
}

async function start() {
  $("round").hidden = false;
  if (typeof DecompressionStream === "undefined") {
    $("round").innerHTML = "<p>This browser is too old for the part in the round; the figures and still pictures are all here.</p>";
    return;
  }
  $("round-note").textContent =
    `${data.every === 1 ? "Every cell is one voxel" : `Every cell is ${data.every} x ${data.every} x ${data.every} voxels, and shows a wrong one where there is one`} of ` +
    `${data.voxel_mm} mm. ${data.grows}`;
  startRound();
  legend();
  showTime();
  await comeNear();
  await drawRound();
  document.documentElement.dataset.ready = "yes";
  if (location.hash === "#selftest") await selftest();
}
start();
