'use strict';
// Scans of prints: dropped on a job that is done, what they say, the next print, and how prints wander.
let scanJob = null, scanned = '', drifts = '';
const scanFiles = new Parts($('scan-drop'), $('scan-file'), $('scan-files'), /\.(stl|ply|obj|off|3mf|npy)(\.gz)?$/i, () => measureScans().catch((e) => tell(e, $('scan-said'))),
  // A scan is of the job that was shown when it was dropped.
  (item) => { item.job = scanJob; return null; });

const scanAt = (s) => 'api/v1/jobs/' + s.job + '/scans/' + s.number;
const scanWords = (s) => sentence('scan ' + s.number + ', ' + s.file + ', ' + moment(s.at_ms) + (s.user ? ', by ' + s.user : '') + ': ' + s.words);

// The scans of the job that is shown; `mine`: who looks may change it.
async function jobScans(j, mine) {
  const box = $('scans');
  box.hidden = j.state !== 'done' || j.kind === 'tomo';
  if (box.hidden) { scanJob = null; scanned = ''; return; }
  if (!scanJob || scanJob.id !== j.id) { $('scan-said').replaceChildren(); $('next-said').replaceChildren(); scanned = ''; }
  scanJob = j;
  const list = (await read('api/v1/jobs/' + j.id + '/scans')).scans;
  if (!scanJob || scanJob.id !== j.id) return;
  $('scan-new').hidden = !mine;
  $('next-box').hidden = !mine || !list.length;
  const now = JSON.stringify(list) + mine;
  if (now === scanned) return;
  scanned = now;
  $('scan-list').replaceChildren(...(list.length ? list.map((s) => {
    const line = el('div', undefined, 'scan'), row = el('p', undefined, 'controls'), named = ' of scan ' + s.number;
    line.append(el('p', scanWords(s)), row);
    row.append(link(scanAt(s) + '/html', 'See it in the round', 'See the page' + named),
      link(scanAt(s) + '/json', 'All figures (JSON)', 'All figures' + named),
      link(scanAt(s) + '/scan', 'The file', 'The file' + named, true));
    if (mine) {
      const remove = button('Remove', async () => { await act(scanAt(s) + '/remove'); scanned = ''; await look(); });
      remove.setAttribute('aria-label', 'Remove scan ' + s.number);
      row.append(remove);
    }
    return line;
  }) : [el('p', 'No print of this job was scanned.', 'dim')]));
}

// Each scan that came is measured, one after the other.
let measuring = false;
async function measureScans() {
  if (measuring) return;
  measuring = true;
  try {
    for (let item; (item = scanFiles.there[0]);) {
      const job = item.job, request = {scan: item.part, unit: $('scan-unit').value};
      if (/\.npy(\.gz)?$/i.test(item.name)) {
        const voxel = Number($('scan-voxel').value);
        if (!(voxel > 0)) { scanFiles.remove(item); throw new FieldError($('scan-voxel'), 'Say how long the side of a voxel is, then drop the volume again.'); }
        request.voxel_um = voxel;
      }
      const done = await study(request, $('scan-said'), 'api/v1/jobs/' + job.id + '/scans');
      scanFiles.remove(item);
      if (!done) return;
      const kept = await read(done.path + '/files/scan.json');
      $('scan-said').replaceChildren(el('span', sentence((scanJob && scanJob.id === job.id ? 'the print is ' : 'the print of job ' + job.id + ' is ') + kept.words), 'done-well'));
      scanned = '';
      await look();
    }
  } finally { measuring = false; }
}

$('scan-next').addEventListener('click', async () => {
  clear();
  const job = scanJob;
  $('scan-next').disabled = true;
  try {
    const done = await study({}, $('next-said'), 'api/v1/jobs/' + job.id + '/next');
    if (!done) return;
    const next = await read(done.path + '/files/next.json'), all = el('details'), row = el('p', undefined, 'controls');
    all.append(el('summary', 'What the scans told'), el('pre', next.words, 'log'));
    const first = el('p');
    first.append(jobLink(next.job, 'Job ' + next.job), ' is queued, corrected with what the scans told. Edges of the print that was scanned are off by '
      + um(next.edges_mean_um) + ' in the mean, as it is understood now; what is expected of the next one stands there when it is done.');
    for (const f of done.files.filter((x) => x.name.endsWith('.toml'))) row.append(link(done.path + '/files/' + f.name, f.name, 'Download ' + f.name, true));
    if (may('operate')) {
      row.append(button('Add the resin', async () => {
        const r = await change('api/v1/resins', {study: done.study});
        row.append(el('span', 'The resin ' + r.resin + ' is there.', 'done-well'));
      }));
    }
    $('next-said').replaceChildren(first, ...next.notes.map((n) => el('p', sentence(n), 'holds')), all, row);
    await look();
  } catch (e) { tell(e, $('scan-next')); } finally { $('scan-next').disabled = false; }
});

// That a job was corrected with what scans told, and what is expected of it.
function afterScans(j) {
  const a = j.after_scans_of;
  if (!a) return '';
  const h = j.figures && j.figures.height_error_um, said = el('dd');
  said.append('corrected with what scans of ', jobLink(a.job, 'job ' + a.job), ' told; edges of that print are off by ' + um(a.edges_mean_um) + ' in the mean, of this one '
    + (h ? um(h.mean_abs) + ' are expected' : 'it is not known yet'));
  return said;
}

// Charts of prints over time.
async function wander() {
  const prints = (await read('api/v1/drift')).prints, now = JSON.stringify(prints);
  if (now === drifts) return;
  drifts = now;
  $('wander').hidden = !prints.length;
  const boxes = [];
  for (const p of prints) {
    const box = el('div'), q = new URLSearchParams({printer: p.printer, resin: p.resin}), last = p.scans[p.scans.length - 1];
    box.append(el('h3', p.printer + ', ' + p.resin), el('p', count(p.scans.length) + (p.scans.length === 1 ? ' scan. ' : ' scans. ') + 'The last print is ' + last.words + '.'));
    if (p.beyond) box.append(el('p', sentence(p.beyond), 'holds'));
    if (p.drift) {
      const figure = el('figure', undefined, 'wide'), picture = el('img'), scroll = el('div', undefined, 'scroll');
      picture.alt = 'Deviation of each print on ' + p.printer + ' with ' + p.resin + ', and the band of those before the last';
      picture.src = await blobUrl('api/v1/drift.svg?' + q);
      picture.className = 'picture';
      picture.addEventListener('load', () => URL.revokeObjectURL(picture.src), {once: true});
      figure.append(picture);
      scroll.tabIndex = 0;
      scroll.setAttribute('role', 'region');
      scroll.setAttribute('aria-label', 'Prints on ' + p.printer + ' with ' + p.resin);
      scroll.append(figure);
      box.append(scroll, link('api/v1/drift.html?' + q, 'All prints of it', 'All prints on ' + p.printer + ' with ' + p.resin));
    } else box.append(el('p', 'A chart needs three.', 'dim'));
    boxes.push(box);
  }
  $('drifts').replaceChildren(...boxes);
}
