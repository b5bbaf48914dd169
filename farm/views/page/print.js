'use strict';
// From parts to jobs: plate, speed, before and after, queue. Each step asks the server for a study.
const meshName = /\.(stl|obj|ply|off|3mf)(\.gz)?$/i;
// Names of parts: meshes, and the archives that the farm reads by its table of formats.
let endings = ['.uvj', '.sl1', '.zip'];
const partName = {test: (name) => meshName.test(name) || endings.some((e) => name.toLowerCase().endsWith(e))};
const round = new PlateView($('round'), showPieces, partMoved), layers = new LayerView($('layer-canvas'), $('layer'), $('layer-said'));
const value = (id) => ($(id).value === '' ? undefined : Number($(id).value));
let printers = [], resins = [], formats = [], plan = null;
// How parts share the plate: null as in their files, else keys of jobs.
let placing = null, moving = 0;

let settings = {}, schemas = {};  // by the description of the API

const parts = new Parts($('drop'), $('files'), $('parts'), partName, partsChanged, ownOf);

// Of several parts each has its own size, turn and number, as prints of their own and on one plate.
function ownOf(item) {
  const box = el('div', undefined, 'own'), fields = {box};
  const add = (key, words, type, more) => {
    const label = el('label', words + ' '), input = el('input');
    Object.assign(input, {type, ...more});
    input.setAttribute('aria-label', words + ' of ' + item.name);
    input.addEventListener('change', () => { if (key === 'copies') placing = null; stale(); });
    label.append(input);
    box.append(label);
    fields[key] = input;
  };
  add('fit_mm', 'Longest side, mm', 'number', {min: 0.001, step: 'any', placeholder: 'as below'});
  add('rotate_deg', 'Turned about x, y, z, degrees', 'text', {placeholder: 'as below'});
  add('copies', 'Copies', 'number', {min: 1, max: 1000, placeholder: 'as below'});
  box.hidden = true;
  return fields;
}
function showOwn() {
  const own_ = parts.there.length > 1 && !inside().length;
  for (const {own, name, part} of parts.items) {
    if (!own) continue;
    own.box.hidden = !own_ || !part;
    for (const key of ['fit_mm', 'rotate_deg']) own[key].parentElement.hidden = !meshName.test(name);
  }
}
const ownCopies = (p) => (p.own && p.own.copies.value ? Number(p.own.copies.value) : 0);
// What was found holds for what was said before.
function stale() {
  for (const id of ['plate', 'planned', 'checked']) $(id).hidden = true;
  plan = null;
}

function partsChanged() {
  const there = parts.there, several = there.length > 1;
  const archives = there.filter((p) => !meshName.test(p.name)).length;
  placing = null;
  $('how').hidden = !several;
  $('how-inside').hidden = archives !== 1;
  if (archives !== 1 && how() === 'inside') document.querySelector('input[name=how]').checked = true;
  showPlacing();
  showOwn();
  showSpeed();
  $('which').replaceChildren(...there.map((p) => new Option(p.name, p.part)));
  for (const id of ['look', 'plan', 'check', 'queue']) $(id).disabled = !there.length || !may('submit');
  // What was found holds for other parts.
  for (const id of ['plate', 'planned', 'checked']) $(id).hidden = true;
}
function how() { return document.querySelector('input[name=how]:checked').value; }
const together = () => !$('how').hidden && how() === 'plate';
// Meshes that an archive holds beside its supports.
const inside = () => (!$('how').hidden && how() === 'inside' ? parts.there.filter((p) => meshName.test(p.name)) : []);
// The parts that are looked at: all of the plate, the archive, or one print of several.
const chosen = () => (together() ? parts.there.flatMap((p) => Array(Math.max(1, ownCopies(p))).fill(p)) : inside().length ? parts.there.filter((p) => !meshName.test(p.name)) : parts.there.filter((p) => $('how').hidden || p.part === $('which').value));
function showPlacing() { $('placing').hidden = !together(); showOwn(); }

// --- parts on one plate, moved by mouse and keys -------------------------------------------------------------------

function showPieces(focus) {
  const list = round.pieces;
  $('pieces').hidden = list.length < 2;
  const words = (p) => p.name + ': x ' + p.x_mm.toFixed(2) + ', y ' + p.y_mm.toFixed(2) + ' mm' + (p.quarter_turns ? ', turned by ' + 90 * p.quarter_turns + '°' : '');
  if ($('pieces').children.length !== list.length) {
    $('pieces').replaceChildren(...list.map((p, k) => {
      const b = button('', () => round.choose(k));
      b.addEventListener('focus', () => { if (round.chosen !== k) round.choose(k); });
      b.addEventListener('keydown', (e) => pieceKey(e, k));
      return b;
    }));
  }
  list.forEach((p, k) => {
    const b = $('pieces').children[k];
    b.textContent = words(p);
    b.setAttribute('aria-pressed', k === round.chosen);
    if (k === focus && document.activeElement === $('round')) b.focus();
  });
}
function pieceKey(e, k) {
  const step = e.shiftKey ? 0.1 : 1, keys = {ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step]};
  if (e.ctrlKey || e.metaKey || e.altKey) return;
  if (keys[e.key]) round.shift(k, ...keys[e.key]);
  else if (e.key.toLowerCase() === 'r' && $('turn_about_z').checked) round.quarter(k);
  else return;
  e.preventDefault();
  partMoved();
}
// What is shown is what is printed: the plate is sliced again where parts lie now, and says what overlaps.
function partMoved() {
  placing = {places_mm: round.pieces.flatMap((p) => [p.x_mm, p.y_mm]), quarter_turns: round.pieces.map((p) => p.quarter_turns)};
  showPieces(-1);
  for (const id of ['planned', 'checked']) $(id).hidden = true;
  clearTimeout(moving);
  moving = setTimeout(function again() { if ($('look').disabled) moving = setTimeout(again, 300); else $('look').click(); }, 600);
}
$('arrange').addEventListener('click', () => {
  placing = {arrange: true};
  if (value('spacing_mm') !== undefined) placing.spacing_mm = value('spacing_mm');
  if ($('turn_about_z').checked) placing.turn_about_z = true;
  $('look').click();
});
$('as-files').addEventListener('click', () => { placing = null; $('look').click(); });

function numbers(text, key, n, field) {
  if (!text.trim()) return undefined;
  const list = text.split(/[\s,;]+/).filter(Boolean).map(Number);
  if ((n && list.length !== n) || list.some((v) => !Number.isFinite(v))) throw new FieldError(field, key + ': expected ' + (n ? n + ' ' : '') + 'numbers.');
  return list;
}

// Sizes and turns of parts that share the plate, where one has its own: a list for all of them.
function ownOnPlate(s, list) {
  if (list.some((p) => p.own && p.own.fit_mm.value)) {
    s.own_fit_mm = list.map((p) => Number((p.own && p.own.fit_mm.value) || 0));
    if (s.own_fit_mm.every((mm) => mm > 0)) delete s.fit_mm;
  }
  if (list.some((p) => p.own && p.own.rotate_deg.value.trim())) {
    s.own_rotate_deg = list.flatMap((p) => (p.own && numbers(p.own.rotate_deg.value, 'Turned about x, y, z', 3, p.own.rotate_deg)) || s.rotate_deg || [0, 0, 0]);
    delete s.rotate_deg;
  }
}

// What the form says, for studies and for jobs: keys are those of jobs files.
function setup(list) {
  const s = {printer: $('printer').value, resin: $('resin').value, mode: $('mode').value};
  if (value('layer_um') !== undefined) s.layer_um = value('layer_um');
  if (list.every((p) => meshName.test(p.name))) {
    if ($('units').value !== 'auto') s.units = $('units').value;
    if (value('fit_mm') !== undefined) s.fit_mm = value('fit_mm');
    const rotate = numbers($('rotate').value, 'Turned about x, y, z', 3, $('rotate'));
    if (rotate) s.rotate_deg = rotate;
    const own = list.length === 1 && parts.there.length > 1 && !together() ? list[0].own : null;
    if (own && own.fit_mm.value) s.fit_mm = Number(own.fit_mm.value);
    const turned = own && numbers(own.rotate_deg.value, 'Turned about x, y, z', 3, own.rotate_deg);
    if (turned) s.rotate_deg = turned;
  }
  if (together()) {
    ownOnPlate(s, list);
    // Copies of a part would lie in each other.
    Object.assign(s, placing || (list.length > parts.there.length ? {arrange: true} : {}));
    if ($('join').checked) s.overlap = 'join';
  }
  if (inside().length && list.every((p) => !meshName.test(p.name))) s.part_inside = inside().map((p) => p.part);
  return s;
}
// Layer by layer a slicer's file says its exposures itself.
function speed(list) {
  if (value('speed') === undefined && $('mode').value === 'layerwise' && list.every((p) => !meshName.test(p.name))) return {};
  if (value('speed') === undefined && settings.layer_exposure_s && settings.layer_exposure_s.input.value.trim()) return {};
  if (value('speed') === undefined) throw new FieldError($('speed'), 'Say the ' + ($('mode').value === 'layerwise' ? 'exposure' : 'speed') + ', or let it be found.');
  return $('mode').value === 'layerwise' ? {exposure_s: value('speed')} : {speed_mm_h: value('speed')};
}
// A plan may hold with settings of its own only.
const withPlan = () => (plan && plan.edge_aim_um !== null && plan.edge_aim_um !== undefined && value('speed') === plannedSpeed() ? {edge_aim_um: plan.edge_aim_um} : {});

// --- more settings: what the API takes beside what the form asks --------------------------------------------------

const kinds = {plan: 'PlanStudy', check: 'CheckStudy', job: 'JobKeys'};
const isList = (schema) => schema.type === 'array';
function settingInput(schema) {
  if (schema.enum || schema.type === 'boolean') {
    const e = el('select');
    e.append(new Option('', ''), ...(schema.enum || ['yes', 'no']).map((w) => new Option(w)));
    return e;
  }
  const e = el('input');
  e.type = schema.type === 'number' || schema.type === 'integer' ? 'number' : 'text';
  if (e.type === 'number') { e.step = schema.type === 'integer' ? 1 : 'any'; for (const [a, k] of [['min', 'minimum'], ['max', 'maximum']]) if (schema[k] !== undefined) e[a] = schema[k]; }
  if (isList(schema)) e.placeholder = 'numbers with commas between';
  return e;
}
// A key with its unit as people write it.
const units = {um: 'um', s: 's', mm_h: 'mm/h', mm: 'mm', mw_cm2: 'mW/cm²', mj_cm3: 'mJ/cm³'};
function wordsOf(key) {
  const unit = Object.keys(units).sort((a, b) => b.length - a.length).find((u) => key.endsWith('_' + u));
  const words = (unit ? key.slice(0, -unit.length - 1) : key).replace(/_/g, ' ').replace(/^uv\b/, 'UV');
  return words.charAt(0).toUpperCase() + words.slice(1) + (unit ? ', ' + units[unit] : '');
}
function showSettings() {
  const groups = new Map();
  for (const [key, schema] of Object.entries(schemas.JobKeys.properties)) {
    const group = schema['x-group'];
    if (!group || $(key) || key === 'speed_mm_h' || key === 'exposure_s') continue;
    if (!groups.has(group)) groups.set(group, []);
    const label = el('label', wordsOf(key)), input = settingInput(schema), words = el('span', schema.description, 'dim');
    input.id = 'set-' + key;
    words.id = 'of-' + key;
    input.setAttribute('aria-describedby', words.id);
    label.append(input, words);
    groups.get(group).push(label);
    settings[key] = {schema, input};
  }
  $('settings').replaceChildren(...[...groups].flatMap(([group, labels]) => { const form = el('div', undefined, 'form'); form.append(...labels); return [el('h3', group), form]; }));
}
// Layers of different heights, in place of layer_um.
const ownHeights = ['layer_heights_um', 'adaptive_um'];
// Values of those that are said and that this kind of request takes.
function moreSettings(kind) {
  const said = {};
  for (const [key, {schema, input}] of Object.entries(settings)) {
    const text = input.value.trim();
    if (!text) continue;
    if (!(key in schemas[kinds[kind]].properties)) {
      if (ownHeights.includes(key)) throw new FieldError(input, key + ': for jobs alone; what is looked at and planned has layers of one height.');
      continue;
    }
    const number = Number(text);
    if (input.validity && !input.validity.valid) throw new FieldError(input, wordsOf(key) + ': ' + input.validationMessage);
    if (isList(schema)) said[key] = numbers(text, wordsOf(key), 0, input);
    else if (schema.type === 'boolean') said[key] = text === 'yes';
    else said[key] = schema.type === 'string' || !Number.isFinite(number) ? text : number;
  }
  return said;
}
$('more').addEventListener('input', () => {
  const said = Object.entries(settings).filter(([, s]) => s.input.value.trim()).map(([key]) => key);
  $('more-said').textContent = said.length ? '(' + said.join(', ') + ')' : '';
});

// Programs name options; here their fields have words.
pageWords = (text) => text.replace(/--([a-z][a-z-]*[a-z])/g, (all, option) => { const key = option.replace(/-/g, '_'); return schemas.JobKeys && key in schemas.JobKeys.properties ? '“' + wordsOf(key) + '”' : all; });

const plannedSpeed = () => plan.speed_mm_h ?? plan.exposure_s;

// Fields of the page whose values are no numbers in their range are said at the field.
function checkFields() {
  for (const e of document.querySelectorAll('#setup input, #h-speed ~ .form input, .own input, #copies')) {
    if (e.validity && !e.validity.valid && !e.closest('[hidden]')) throw new FieldError(e, e.validationMessage);
  }
}
// A refusal that begins with the name of a setting is said at its field.
function fieldOf(words) {
  const key = (/^([A-Za-z_]+)[: ]/.exec(words) || [])[1], at = {speed_mm_h: 'speed', exposure_s: 'speed', rotate_deg: 'rotate'}[key?.toLowerCase()] || key?.toLowerCase();
  return at && ($('set-' + at) || (/_/.test(at) || at === 'speed' || at === 'rotate' ? $(at) : null));
}
async function during(id, work) {
  clear();
  $(id).disabled = true;
  try { checkFields(); await work(); } catch (e) { if (!e.field) e.field = fieldOf(e.message || ''); tell(e, $(id)); } finally { $(id).disabled = !parts.there.length; }
}
const asks = (kind, list, more) => ({kind, parts: list.map((p) => p.part), ...setup(list), ...more});

$('look').addEventListener('click', () => during('look', async () => {
  const list = chosen(), request = asks('plate', list, {});
  delete request.mode;
  delete request.part_inside;
  const s = await study(request, $('plate-said'));
  // Parts that are being moved stay in sight where they overlap.
  $('plate').hidden = !s && !(placing && placing.places_mm);
  if (!s) return;
  const f = await read(s.path + '/files/plate.json');
  const size = f.upper_mm.map((u, k) => (u - f.lower_mm[k]).toFixed(2));
  const facts_ = el('dl');
  facts(facts_, [['Size', size.join(' x ') + ' mm on a plate of ' + f.plate_mm.map((v) => figure(v)).join(' x ') + ' mm'], ['Layers', count(f.layers) + ' of ' + figure(f.layer_um) + ' um'],
    ['Volume', f.volume_ml > 0 ? figure(f.volume_ml) + ' ml' : ''], ['Triangles', f.triangles ? count(f.triangles) + (f.shown_triangles < f.triangles ? ', ' + count(f.shown_triangles) + ' shown' : '') : ''],
    ['Remarks on the mesh', f.defects.join('; ')]]);
  $('plate-facts').replaceChildren(facts_);
  const pieces = together() ? f.parts.map((p, k) => ({...p, name: list[k].name})) : [];
  round.show(readTriangles(await (await ask(s.path + '/files/plate.bin')).arrayBuffer()), f.plate_mm, pieces);
  // Parts that were arranged stay where they were put.
  if (placing) placing = {places_mm: pieces.flatMap((p) => [p.x_mm, p.y_mm]), quarter_turns: pieces.map((p) => p.quarter_turns)};
  showPieces(-1);
  await layers.show(s.path, f);
  $('round').dataset.triangles = f.shown_triangles;
}));

$('plan').addEventListener('click', () => during('plan', async () => {
  const list = chosen(), request = asks('plan', list, {...moreSettings('plan'), tolerance_um: value('tolerance_um'), gap_contrast: value('gap_contrast')});
  const s = await study(request, $('plan-said'));
  $('planned').hidden = true;
  if (!s) return;
  plan = await read(s.path + '/files/plan.json');
  const what = plan.speed_mm_h !== undefined && plan.speed_mm_h !== null ? figure(plan.speed_mm_h) + ' mm/h' : figure(plan.exposure_s) + ' s for each layer';
  $('plan-words').textContent = what + ' is the fastest with edges within ' + figure(plan.tolerance_um) + ' um and a contrast of ' + plan.gap_contrast + ' in gaps; the print takes ' + (plan.print_time_s === null ? duration(plan.light_s) + ' of light (lifts not known)' : duration(plan.print_time_s) + (plan.light_s < plan.print_time_s ? ', of it ' + duration(plan.light_s) + ' of light' : ''))
    + '. What limits it: ' + (plan.limit || plan.limited_by) + '.' + (plan.with ? ' It holds with ' + plan.with + '.' : '')
    + (plan.ramp_mm ? ' The lamps follow the stage over the first and last ' + figure(plan.ramp_mm) + ' mm.' : '');
  $('use').textContent = 'Use ' + what;
  $('plan-picture').src = await blobUrl(s.path + '/files/plan.svg');
  $('planned').hidden = false;
}));
$('use').addEventListener('click', () => { $('speed').value = plannedSpeed(); });

$('check').addEventListener('click', () => during('check', async () => {
  const list = chosen(), s = await study(asks('check', list, {...moreSettings('check'), ...speed(list), ...withPlan()}), $('check-said'));
  $('checked').hidden = true;
  if (!s) return;
  const f = await read(s.path + '/files/check.json'), before = f.uncorrected;
  const h = f.height_error_um, [x, y] = f.worst_pixel || [-1, -1];
  $('worst').textContent = (h && h.max_abs !== null ? 'The worst place is ' + um(h.max_abs) + ' off' + (before && before.height_error_um ? ', where without correction the worst is ' + um(before.height_error_um.max_abs) : '') + '. ' : '')
    + (x >= 0 ? 'It is at pixel ' + x + ', ' + y + '; the section goes through it.' : '');
  // Of a slicer's file the report alone has both.
  const row = (words, of) => (before ? [words, of(before), of(f)] : [words, of(f)]);
  const off = (key) => (v) => (v.height_error_um && v.height_error_um[key] !== null ? um(v.height_error_um[key]) : '-');
  const number = (key) => (v) => (v[key] === undefined ? '-' : count(v[key]));
  $('figures').replaceChildren(tableOf([before ? ['Figure', 'as sliced', 'corrected'] : ['Figure', 'corrected'], row('Height error, mean', off('mean_abs')), row('95 % within', off('p95_abs')), row('largest', off('max_abs')),
    row('Lost features', number('lost_features')), row('Merged gaps', number('merged_features')), row('Voxels cured through', number('cure_through_voxels')), row('Voxels undercured', number('undercure_voxels'))], 'What prints'));
  $('section').src = await blobUrl(s.path + '/files/section.png');
  $('check-link').replaceChildren(link(s.path + '/files/check.html', 'All of it, as sliced and corrected: sections in three directions, doses, lists of places'));
  $('checked').hidden = false;
}));

// Queues jobs; of several those that can be done, where others are refused. Gives the answer, and what was refused.
async function queueThose(jobs, nameOf) {
  const refused = [];
  let left = jobs.map((job, n) => n);
  while (left.length) {
    try { return [await change('api/v1/jobs', {jobs: left.map((n) => jobs[n])}), refused]; } catch (e) {
      const errors = e.errors || [];
      if (jobs.length < 2 || !errors.length || errors.some((x) => x.job === undefined)) throw e;
      const bad = new Map(errors.map((x) => [left[x.job], x.message]));
      for (const [job, message] of bad) refused.push({job, message});
      left = left.filter((n) => !bad.has(n));
    }
  }
  throw new Error(refused.map(({job, message}) => ofPart(nameOf(job), message)).join(' '));
}
// What was said of a part, with its name once.
const ofPart = (name, message) => name + ': ' + sentence(message.replace(name + ': ', ''));

$('queue').addEventListener('click', () => during('queue', async () => {
  const all = parts.there, prints = together() ? [chosen()] : inside().length ? [chosen()] : all.map((p) => [p]);
  const more = {...moreSettings('job'), ...speed(prints.flat()), ...withPlan()};
  if ($('ready').value) more.ready_by = $('ready').value;
  if (value('copies') > 1) more.copies = value('copies');
  const labels = $('labels').value.split(',').map((l) => l.trim()).filter(Boolean);
  if (labels.length) more.labels = labels;
  const jobs = prints.map((list) => {
    const job = {parts: list.map((p) => p.part), ...setup(list), ...more}, own = list.length === 1 && all.length > 1 ? ownCopies(list[0]) : 0;
    if (own) job.copies = own;
    const format = formatOf(list);
    if (format && !job.format && !job.for) job.format = format;
    return job;
  });
  if (ownHeights.some((key) => key in more)) for (const job of jobs) delete job.layer_um;
  $('queue-said').textContent = 'reading and checking ' + (jobs.length === 1 ? 'the part' : count(jobs.length) + ' parts');
  const nameOf = (job) => prints[job].map((p) => p.name).join(', ');
  let r, refused = [];
  try { [r, refused] = await queueThose(jobs, nameOf); } catch (e) { $('queue-said').textContent = ''; throw e; }
  const rows = [['Job', 'name', 'layers', 'takes about']];
  r.ids.forEach((id, n) => { const e = r.estimates[Math.min(n, r.estimates.length - 1)]; rows.push([id, e.name, count(e.layers), e.duplicate || e.cached ? 'done before' : duration(e.seconds)]); });
  $('queue-said').textContent = r.ids.length === 1 ? 'One job is queued.' : count(r.ids.length) + ' jobs are queued.';
  const farm = el('p'), a = el('a', 'Watch them on the farm');
  a.href = './';
  farm.append(a);
  $('queued').replaceChildren(...refused.map(({job, message}) => {
    const said = el('p', nameOf(job) + ' was not queued: ' + sentence(message.replace(nameOf(job) + ': ', '')), 'holds');
    said.setAttribute('role', 'alert');
    return said;
  }), tableOf(rows, 'What was queued'), ...(r.notices || []).map((words) => el('p', sentence(words))), farm);
}));

for (const [id, view] of [['round', round], ['layer', layers]]) {
  $(id + '-in').addEventListener('click', () => view.scale(1.3));
  $(id + '-out').addEventListener('click', () => view.scale(1 / 1.3));
}
$('more').addEventListener('change', () => { stale(); });
$('setup').addEventListener('change', () => { stale(); });
$('how').addEventListener('change', (e) => {
  showPlacing();
  if (['spacing_mm', 'turn_about_z'].includes(e.target.id)) return;
  if (e.target.name === 'how') placing = null;
  stale(); });
function showSpeed() {
  const layers = $('mode').value === 'layerwise', list = parts.there;
  $('speed-words').textContent = layers ? 'Exposure, s' : 'Speed, mm/h';
  $('speed').placeholder = layers && list.length && list.every((p) => !meshName.test(p.name)) ? 'as in the file' : '';
}
// Printers that read slicers' files stand still for each layer, until the person says otherwise.
let modeChosen = false;
$('mode').addEventListener('change', (e) => { if (e.isTrusted) modeChosen = true; showSpeed(); $('speed').value = ''; });
function modeOf(printer) {
  const mode = printer && (printer.reads || []).length ? 'layerwise' : 'continuous';
  if (modeChosen || !printer || $('mode').value === mode) return;
  $('mode').value = mode;
  $('speed').value = '';
  showSpeed();
}

// --- printers and resins: those that work first, and a search ----------------------------------------------------

const measured = (p) => typeof p.calibration !== 'string';
// As `resinctl list --for` has it: the same wavelength within 10 nm, and the same unit of light.
const goWith = (p, r) => !(p.wavelength_nm && r.wavelength_nm && Math.abs(p.wavelength_nm - r.wavelength_nm) > 10) && !(measured(p) && p.unit && r.unit && p.unit !== r.unit);
const firstThatWorks = () => (printers.find((p) => measured(p) && resins.some((r) => goWith(p, r))) || printers[0] || {name: ''}).name;
const printerNow = () => printers.find((p) => p.name === $('printer').value);
// Options in groups; what is chosen stays in the list, whatever is looked for.
function listOf(id, groups) {
  const was = $(id).value, words = $('find-' + id).value.toLowerCase().split(/\s+/).filter(Boolean);
  const found = (x) => x.name === was || words.every((w) => [x.name, x.maker, x.product, x.colour, x.chemistry, x.wavelength_nm, ...(x.aliases || [])].join(' ').toLowerCase().includes(w));
  $(id).replaceChildren(...groups.map(([label, list]) => {
    const group = el('optgroup');
    group.label = label;
    group.append(...list.filter(found).map((x) => new Option(x.name)));
    return group;
  }).filter((g) => g.children.length));
  if ([...$(id).options].some((o) => o.value === was)) $(id).value = was;
}
function listPrinters() { listOf('printer', [['Their light is known', printers.filter(measured)], ['Light to be measured: only Show works', printers.filter((p) => !measured(p))]]); }
function listResins() {
  const p = printerNow();
  const goes = resins.filter((r) => !p || goWith(p, r));
  listOf('resin', [['Go with this printer', goes], ['Measured in other light', resins.filter((r) => !goes.includes(r))]]);
}
function showLight() {
  const p = printerNow(), r = resins.find((x) => x.name === $('resin').value);
  $('light-said').textContent = !p ? '' : !measured(p) ? 'The light of this printer is to be measured (Resins and printers). Until then Show works; the rest does for a slicer’s file with “Assume” under More settings, which takes a typical display.'
    : r && !goWith(p, r) ? 'This resin was measured in light of ' + (r.wavelength_nm || '?') + ' nm, the printer has ' + (p.wavelength_nm || '?') + ' nm.' : '';
}
for (const id of ['printer', 'resin']) {
  $('find-' + id).addEventListener('input', (e) => {
    e.stopPropagation();
    id === 'printer' ? listPrinters() : listResins();
    const count_ = $(id).options.length;
    $('light-said').textContent = count_ + (count_ === 1 ? ' is' : ' are') + ' in the list.';
  });
  $('find-' + id).addEventListener('change', (e) => e.stopPropagation());
  $(id).addEventListener('change', () => { if (id === 'printer') { const was = $('resin').value; listResins(); if (!goes(was)) $('resin').selectedIndex = 0; modeOf(printerNow()); } showLight(); });
}
function goes(name) { const p = printerNow(), r = resins.find((x) => x.name === name); return p && r && goWith(p, r); }
// Layer by layer a printer gets a file that it reads, where the parts are meshes.
function formatOf(list) {
  const p = printerNow();
  if (!p || !p.reads || $('mode').value !== 'layerwise' || !list.every((x) => meshName.test(x.name))) return undefined;
  const ending = p.reads.find((e) => formats.some((f) => f.made_new && f.endings.includes(e)));
  return ending && ending.replace(/^\./, '');
}
$('find-setting').addEventListener('input', (e) => {
  e.stopPropagation();
  const words = $('find-setting').value.toLowerCase().split(/\s+/).filter(Boolean);
  for (const label of document.querySelectorAll('#settings label')) label.hidden = !words.every((w) => label.textContent.toLowerCase().includes(w));
  for (const form of document.querySelectorAll('#settings .form')) form.previousElementSibling.hidden = form.hidden = ![...form.children].some((l) => !l.hidden);
});

// Signing in begins again: what was said since stays said; else what was chosen last is chosen again.
for (const id of ['printer', 'resin', 'layer_um']) $(id).addEventListener('change', () => localStorage.setItem('print-' + id, $(id).value));
begin(async () => {
  $('files').disabled = !may('submit');
  partsChanged();
  const [p, r, description] = await Promise.all([read('api/v1/printers'), read('api/v1/resins'), read('api/v1/openapi.json')]);
  const said = [...document.querySelectorAll('#setup select, #setup input, #settings select, #settings input')].filter((e) => e.id && e.value).map((e) => [e.id, e.value]);
  const again = printers.length > 0;
  schemas = description.components.schemas;
  formats = description['x-formats'] || [];
  endings = formats.flatMap((f) => f.endings);
  showSettings();
  // Tomographic printers print in another way.
  printers = p.filter((x) => x.width_px && x.calibration && !x.vial);
  resins = r;
  const last = (id) => localStorage.getItem('print-' + id);
  listPrinters();
  if (last('printer') && printers.some((x) => x.name === last('printer'))) $('printer').value = last('printer');
  else $('printer').value = firstThatWorks();
  listResins();
  if (last('resin') && resins.some((x) => x.name === last('resin'))) $('resin').value = last('resin');
  if (last('layer_um')) $('layer_um').value = last('layer_um');
  if (!again) modeOf(printerNow());
  showLight();
  if (again) for (const [id, last] of said) if ($(id)) $(id).value = last;
});
