'use strict';
// Resins from measurements, printers by a form, and what there is.
let resins = [], fit = null;
const tables = new Parts($('drop'), $('files'), $('tables'), /\.csv$/i, () => { $('fit').disabled = !tables.there.length; $('fitted').hidden = true; });

const parameterNames = {h_um: 'Absorbance height (to 1/e)', dc_mj_cm2: 'Dose that gels', m: 'Exponent of intensity', critical_dose_prime: 'D′c, dose that gels', gel_a_mj_cm2: 'A of the time to gel', gel_b_sqrt_mw_cm2_s: 'B of the time to gel'};

$('fit').addEventListener('click', async () => {
  clear();
  $('fit').disabled = true;
  $('add-said').textContent = '';
  try {
    const request = {kind: 'fit', data: tables.there.map((t) => t.part), model: $('model').value, name: $('resin-name').value.trim()};
    if ($('bootstrap').value !== '0') request.bootstrap = Number($('bootstrap').value);
    fit = await study(request, $('fit-said'));
    // Not before its figures are there: what is shown till then is another fit's.
    $('fitted').hidden = true;
    if (!fit) return;
    fit.name = request.name;
    const f = await read(fit.path + '/files/fit.json');
    $('fit-words').textContent = 'Fit of ' + count(f.n) + ' measurements: R² ' + f.r2.toFixed(4) + ', residuals of ' + um(f.rmse_um) + ' (RMSE).'
      + (f.outliers.length ? ' ' + count(f.outliers.length) + ' of them lie far off.' : ' None lies far off.');
    $('fit-figures').replaceChildren(tableOf([['Figure', 'value', '95 % within'], ...Object.entries(f.parameters).map(([name, p]) => [parameterNames[name] || name,
      figure(p.value) + ' ' + (p.unit || ''), p.ci95 ? figure(p.ci95[0]) + ' to ' + figure(p.ci95[1]) : '-'])], 'What the fit says'));
    $('fit-warnings').replaceChildren(...(f.warnings || []).map((w) => el('li', typeof w === 'string' ? w : w.message || w.text || JSON.stringify(w))));
    $('fitted').hidden = false;
    $('fit-picture').src = await blobUrl(fit.path + '/files/fit.svg');
  } catch (e) { tell(e, $('fit')); } finally { $('fit').disabled = !tables.there.length; }
});

$('add-resin').addEventListener('click', async () => {
  clear();
  try {
    await change('api/v1/resins', {study: fit.study, replace: $('replace').checked});
    $('add-said').textContent = 'The resin ' + fit.name + ' is there.';
    await list();
  } catch (e) { tell(e, $('add-resin')); }
});

// Ways in which an upright F can be seen: rows and columns changed, then left and right, then top and bottom; in the
// order of their numbers (letter_part.hpp, a test compares the two).
const letterTurns = [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 1, 0], [1, 0, 0], [1, 0, 1], [1, 1, 1]];
const letterF = ['#####', '#    ', '#    ', '#### ', '#    ', '#    ', '#    '];
const letterDots = () => letterF.flatMap((row, y) => [...row].flatMap((c, x) => (c === '#' ? [[x, y]] : [])));
function letterSeen([swap, flipX, flipY]) {
  const wide = swap ? 7 : 5, high = swap ? 5 : 7;
  return letterDots().map(([x, y]) => (swap ? [y, x] : [x, y])).map(([x, y]) => [flipX ? wide - 1 - x : x, flipY ? high - 1 - y : y]);
}
const letterWords = ['upright', 'mirrored left to right', 'upside down', 'mirrored top to bottom', 'on its side, a quarter turn clockwise', 'on its side, mirrored along the diagonal from top left', 'on its side, a quarter turn counter-clockwise', 'on its side, mirrored along the other diagonal'];
function letterChoice(number) {
  const label = el('label'), radio = el('input');
  radio.type = 'radio';
  radio.name = 'f_picture';
  radio.value = number || '';
  radio.checked = !number;
  label.append(radio, ' ');
  if (!number) { label.append('I do not know'); return label; }
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg'), turn = letterTurns[number - 1];
  svg.setAttribute('viewBox', turn[0] ? '-1 -2 9 9' : '-2 -1 9 9');
  svg.setAttribute('role', 'img');
  svg.setAttribute('aria-label', 'an F ' + letterWords[number - 1]);
  for (const [x, y] of letterSeen(turn)) {
    const dot = document.createElementNS('http://www.w3.org/2000/svg', 'rect');
    for (const [name, value] of [['x', x], ['y', y], ['width', 1.02], ['height', 1.02]]) dot.setAttribute(name, value);
    svg.append(dot);
  }
  label.append(String(number), ' ', svg);
  return label;
}
$('letters').replaceChildren(...[1, 2, 3, 4, 5, 6, 7, 8, 0].map(letterChoice));
// An F as large as the display.
$('letter-file').addEventListener('click', (event) => {
  const form = $('new-printer').elements, wide = Number(form.width_px.value), high = Number(form.height_px.value);
  const canvas = el('canvas');
  if (!(wide >= 7 && high >= 9 && wide * high <= 2e8)) {
    event.preventDefault();
    tell(new FieldError(form.width_px, 'Say how many pixels the display has, across and down; the picture is as large.'));
    return;
  }
  if (event.currentTarget.href.startsWith('blob:')) return;
  event.preventDefault();
  const at = event.currentTarget;
  canvas.width = wide;
  canvas.height = high;
  const dot = Math.floor(Math.min(wide / 7, high / 9)), pen = canvas.getContext('2d');
  pen.fillStyle = '#000';
  pen.fillRect(0, 0, wide, high);
  pen.fillStyle = '#fff';
  for (const [x, y] of letterDots()) pen.fillRect(Math.floor((wide - 5 * dot) / 2) + x * dot, Math.floor((high - 7 * dot) / 2) + y * dot, dot, dot);
  canvas.toBlob((blob) => {
    if (!blob) { tell(new Error('This browser makes no picture as large as that.'), at.parentElement); return; }
    at.href = URL.createObjectURL(blob);
    at.click();
    const made = at.href;
    at.href = '#letters';
    setTimeout(() => URL.revokeObjectURL(made), 10000);
  });
});

$('new-printer').addEventListener('submit', async (event) => {
  event.preventDefault();
  clear();
  $('printer-said').textContent = '';
  const form = new FormData(event.target), printer = {name: form.get('name').trim(), replace: form.get('replace') !== null};
  for (const key of ['width_px', 'height_px', 'pixel_um', 'bit_depth', 'wavelength_nm', 'max_speed_mm_h', 'travel_mm', 'f_picture']) if (form.get(key)) printer[key] = Number(form.get(key));
  printer.readings = form.get('readings').split('\n').filter((l) => l.trim()).map((l) => l.trim().split(/[\s,;]+/).map(Number));
  try {
    if (printer.readings.some((r) => r.length !== 2 || r.some((v) => !Number.isFinite(v)))) throw new FieldError(event.target.elements.readings, 'Light at the window: expected a grey level and mW/cm² on each line.');
    await change('api/v1/printers', printer);
    $('printer-said').textContent = 'The printer ' + printer.name + ' is there.';
    await list();
  } catch (e) { tell(e, event.target.querySelector('button[type=submit]') || event.target); }
});

function showResins() {
  const words = $('find').value.toLowerCase().split(/\s+/).filter(Boolean);
  const found = resins.filter((r) => words.every((w) => [r.name, r.maker, r.product, r.colour, r.chemistry].join(' ').toLowerCase().includes(w)));
  // Of calipers alone doses are seconds of the brightest level's light.
  const dose = (d, unit) => (d && d.mj_cm2 !== undefined && d.mj_cm2 !== null ? figure(d.mj_cm2) + (unit === 'of the brightest level' ? ' s of full light' : '') : '-');
  $('resins').replaceChildren(tableOf([['Name', 'light, nm', 'absorbance height, um', 'gels at, mJ/cm²', 'aims at, mJ/cm²', 'curve'],
    ...found.map((r) => [r.name, r.wavelength_nm || '-', r.absorbance_height_um ? figure(r.absorbance_height_um.base_e) : '-', dose(r.gel_dose, r.unit), dose(r.aim, r.unit), button('show', () => curve(r.name), 'link')])], 'Resins, ' + count(found.length) + ' of ' + count(resins.length)));
}
async function curve(name) {
  calm();
  $('curve-picture').src = await blobUrl('api/v1/resins/' + name + '/curve.svg');
  $('curve-title').textContent = name;
  $('curve').hidden = false;
  $('curve-title').focus();
}
$('find').addEventListener('input', showResins);

async function list() {
  const [p, r] = await Promise.all([read('api/v1/printers'), read('api/v1/resins')]);
  resins = r;
  showResins();
  $('printers').replaceChildren(tableOf([['Name', 'pixels', 'pixel, um', 'light, nm', 'brightest, mW/cm²', 'fastest, mm/h'],
    ...p.map((x) => [x.name, x.width_px + ' x ' + x.height_px, x.pixel_um ? x.pixel_um.map(figure).join(' x ') : '-', x.wavelength_nm || '-', Array.isArray(x.calibration) && x.calibration.length ? figure(x.calibration[x.calibration.length - 1][1]) + (x.unit === 'of the brightest level' ? ' (' + x.unit + ')' : '') : 'to be measured', x.max_speed_mm_h ? count(x.max_speed_mm_h) : '-'])], 'Printers'));
}
begin(async () => { $('fit').disabled = !tables.there.length; await list(); });
