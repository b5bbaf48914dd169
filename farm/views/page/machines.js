'use strict';
// What each machine does, and what may be done with it. A stop is always in reach; a start wants two words.
const printing = new Set(['starting', 'printing', 'pausing', 'paused', 'resuming', 'stopping']);
const atRest = new Set(['idle', 'stopped', 'finished']);
let done = [];
// Of each machine its picture and the picture's number; a picture is asked for once.
const pictures = new Map();
async function showPicture(m, image) {
  let known = pictures.get(m.name);
  if (!known || known.number !== m.picture) {
    if (known) URL.revokeObjectURL(known.url);
    known = {number: m.picture, url: await blobUrl('api/v1/machines/' + encodeURIComponent(m.name) + '/picture.png')};
    pictures.set(m.name, known);
  }
  image.src = known.url;
}

async function act(name, what, body) {
  calm();
  await change('api/v1/machines/' + encodeURIComponent(name) + '/' + what, body);
  await look();
}

function boxed(words) {
  const input = el('input'), l = el('label');
  input.type = 'checkbox';
  l.append(input, ' ' + words);
  return [input, l];
}

function words(m) {
  const list = [m.state + (m.phase ? ' (' + m.phase + ')' : '')];
  if (printing.has(m.state) && m.layers) {
    // Some printers never say at which layer they are.
    list.push(m.layer === null ? count(m.layers) + ' layers' : 'layer ' + count(m.layer) + ' of ' + count(m.layers));
  }
  if (printing.has(m.state) && m.left_s !== null) list.push(duration(m.left_s) + ' left');
  return list.join(' · ');
}

// From 0 to 1, by layers or else by time; null where the printer says neither.
function partDone(m) {
  if (m.layers && m.layer !== null) return Math.min(1, m.layer / m.layers);
  return m.left_s !== null && m.run_s !== null && m.run_s + m.left_s > 0 ? m.run_s / (m.run_s + m.left_s) : null;
}

function controls(m, box) {
  const r = m.record;
  if (printing.has(m.state)) {
    box.append(button('Stop', () => act(m.name, 'stop'), 'stop'));
    if (m.state === 'printing') box.append(button('Pause', () => act(m.name, 'pause')));
    if (m.state === 'paused') box.append(button('Go on', () => act(m.name, 'resume')));
    return;
  }
  if (r.plate_full) box.append(button('I looked: the plate is empty now', () => act(m.name, 'cleared')));
  if (!atRest.has(m.state)) return;
  if (r.file_state === 'stored' && !r.plate_full) {
    const [plate, plateLabel] = boxed('I looked: the plate is empty'), [vat, vatLabel] = boxed('resin is in the vat');
    box.append(plateLabel, vatLabel, button('Print ' + (r.real_name || r.file),
      () => act(m.name, 'start', {plate_is_empty: plate.checked, vat_is_filled: vat.checked})));
  }
  const fitting = done.filter((j) => !m.printer || j.printer === m.printer);
  if (!fitting.length || (m.sending && m.sending.running)) return;
  const which = el('select');
  which.setAttribute('aria-label', 'Job for ' + m.name);
  which.append(...fitting.map((j) => new Option(j.id + ' ' + j.name, j.id)));
  box.append(which, button('Send it', () => act(m.name, 'send', {job: Number(which.value)})));
}

function card(m) {
  const box = el('section'), title = el('h2', m.name), r = m.record, list = el('dl');
  box.dataset.machine = m.name;
  box.setAttribute('aria-label', m.name);
  box.append(title);
  if (m.picture) {
    const image = el('img', undefined, 'on-machine');
    image.alt = 'Picture of ' + (printing.has(m.state) && m.file ? m.file : r.real_name || r.file);
    showPicture(m, image).catch(() => image.remove());
    box.append(image);
  }
  const part = partDone(m);
  if (printing.has(m.state) && part !== null) box.append(bar(part, words(m)));
  else box.append(el('p', m.looked ? words(m) : 'not asked yet'));
  if (m.trouble) box.append(el('p', m.trouble, 'holds'));
  const s = m.sending, sending = !s ? '' : s.running ? 'job ' + s.job + ' ' + s.name + ', ' + bytes(s.done) + ' of ' + bytes(s.all)
    : s.message ? 'job ' + s.job + ' was not sent: ' + s.message : '';
  facts(list, [['Printer', m.printer], ['Speaks', m.kind], ['Prints', printing.has(m.state) ? m.file : ''],
    ['Sent last', r.file_state ? (r.real_name || r.file) + (r.job ? ', job ' + r.job : '') + ': ' + r.file_state : ''], ['Being sent', sending],
    ['Print', r.print_state ? r.print_file + ': ' + (r.print_state === 'asked' ? 'whether it began is not known; look at the machine' : r.print_state) : ''],
    ['Plate', r.plate_full ? 'full: ' + r.plate_why : '']]);
  box.append(list);
  if (may('operate')) {
    const row = el('p', undefined, 'controls');
    controls(m, row);
    box.append(row);
  }
  if (m.page) {
    const a = el('a', 'its own page');
    a.href = m.page;
    a.rel = 'noopener';
    a.target = '_blank';
    box.append(a);
  }
  return box;
}

async function look() {
  const answer = await read('api/v1/machines'), list = $('machine-list');
  if (may('operate')) done = (await read('api/v1/jobs?state=done&order=ended&limit=50')).jobs;
  $('none').hidden = answer.machines.length > 0;
  $('file-trouble').hidden = !answer.trouble;
  $('file-trouble').textContent = answer.trouble || '';
  // What somebody ticks or chooses, and what was said to it, stays while machines are looked at again.
  for (const m of answer.machines) {
    const old = [...list.children].find((c) => c.dataset.machine === m.name);
    const state = m.state + m.record.plate_full + m.record.file + m.record.file_state + m.picture;
    const touched = old && (old.contains(document.activeElement) || old.querySelector('input:checked, #said-here'));
    if (touched && old.dataset.state === state) continue;
    const fresh = card(m);
    fresh.dataset.state = state;
    if (old) old.replaceWith(fresh); else list.append(fresh);
  }
  for (const c of [...list.children]) if (!answer.machines.some((m) => m.name === c.dataset.machine)) c.remove();
}

begin(async () => {
  await look();
  const again = () => setTimeout(async () => {
    try { await look(); calm(); } catch (e) { tell(e); }
    again();
  }, 2000);
  again();
});
