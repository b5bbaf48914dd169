// The scanned surface in the colours of its deviations.
const data = JSON.parse(document.getElementById("scan-data").textContent);
const $ = (id) => document.getElementById(id);
let side = 0, view = null;

// Red: too much was printed, blue: too little; grey where it is right.
function colourOf(um, full) {
  const t = Math.max(-1, Math.min(1, um / full)), to = t > 0 ? [214, 40, 40] : [30, 90, 220];
  return [168, 174, 168].map((c, i) => c + (to[i] - c) * Math.abs(t));
}
const fullUm = () => data.scaleUm * $("scale").value / 50;

function draw() {
  const s = data.sides[side], [nx, ny] = data.cells, full = fullUm();
  const places = new Float32Array(3 * s.at.length), normals = new Float32Array(3 * s.at.length);
  s.at.forEach((at, i) => {
    places[3 * i] = at % nx;
    places[3 * i + 1] = Math.floor(at / nx) % ny;
    places[3 * i + 2] = Math.floor(at / (nx * ny));
    for (let k = 0; k < 3; ++k) normals[3 * i + k] = s.normals[3 * i + k] / 10;
  });
  view.draw({ places, normals, colour: s.um.map((um) => colourOf(um, full)) });
  $("scale-out").textContent = `${full.toPrecision(3)} um`;
  const swatch = (um) => `<b><i style="background:rgb(${colourOf(um, full).map(Math.round).join()})"></i>${um > 0 ? "+" : ""}${um.toPrecision(3)} um</b>`;
  $("round-legend").innerHTML = [-full, -full / 2, 0, full / 2, full].map(swatch).join("") + " red: too much was printed, blue: too little";
  $("round-words").textContent = `${s.at.length} places of the scan. The platform is at the top. Drag, or use the arrow keys and + and −.`;
}

$("round").hidden = false;
$("round-sides").innerHTML = data.sides.map((s, i) =>
  `<label><input type="radio" name="side" value="${i}"${i ? "" : " checked"}> ${s.against === "design" ? "the design" : "what was predicted to print"}</label>`).join("");
view = new RoundView($("solid-canvas"), data.cells, data.sizeMm);
view.listen(draw);
for (const radio of document.querySelectorAll("input[name=side]")) {
  radio.addEventListener("change", () => { side = +radio.value; draw(); });
}
$("scale").addEventListener("input", draw);
window.addEventListener("resize", draw);
draw();
