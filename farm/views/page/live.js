'use strict';
const pageSize = 20;
let offset = 0, lastEvent = -1, shown = 0, timelineUrl = '', timer = 0, asked = 0, chosen = false;

function jobLink(id, name) {
  const b = el('button', name, 'link');
  b.type = 'button';
  b.addEventListener('click', () => showJob(id, true));
  return b;
}

function overview(o) {
  const j = o.jobs;
  if (!chosen) {
    // What is worth a look first: what waits, else what failed, else what was done.
    chosen = true;
    const first = j.queued ? 'queued' : j.failed ? 'failed' : j.done ? 'done' : 'queued';
    document.querySelector('input[name=state][value=' + first + ']').checked = true;
  }
  const tiles = [[j.running, 'running', ''], [j.queued, o.followers ? 'queued, ' + count(o.followers) + ' wait for the same work' : 'queued', ''],
    [j.done, o.from_cache ? 'done, ' + count(o.from_cache) + ' from the cache' : 'done', j.done ? 'good' : ''], [j.failed, 'failed', j.failed ? 'bad' : '']];
  if (j.cancelled) tiles.push([j.cancelled, 'cancelled', '']);
  if (o.late) tiles.push([o.late, 'will miss their time', 'bad']);
  $('tiles').replaceChildren(...tiles.map(([n, words, kind]) => {
    const t = el('div', undefined, 'tile ' + kind);
    t.append(el('b', count(n)), el('span', words));
    return t;
  }));
  const ended = j.done + j.failed + j.cancelled, all = ended + j.queued + j.running;
  const part = o.running.reduce((sum, r) => sum + r.attempt.fraction, ended) / Math.max(1, all);
  const whole = $('whole');
  whole.hidden = all === 0;
  whole.setAttribute('aria-valuenow', Math.floor(100 * part));
  whole.querySelector('i').style.width = 100 * part + '%';
  whole.querySelector('b').textContent = Math.floor(100 * part) + ' % of ' + count(all);
  $('pace').textContent = all === 0 ? 'No job was submitted yet.'
    : j.queued + j.running === 0 ? 'Nothing is left to do.'
    : duration(o.queued_s) + ' of work on one core' + (o.eta_s === null ? '' : ', done about ' + moment(o.now_ms + 1000 * o.eta_s));
  $('holds').textContent = j.queued && o.holds ? 'Jobs wait and nothing starts: ' + o.holds + '.' : '';
  $('holds').hidden = !$('holds').textContent;
  $('running').replaceChildren(...(o.running.length ? o.running.map((r) => {
    const row = el('div', undefined, 'run'), name = el('div', undefined, 'name'), a = r.attempt;
    name.append(jobLink(r.id, r.id + ' ' + r.name));
    if (a.number > 1) name.append(' ', el('code', 'attempt ' + a.number));
    const words = [a.stage || a.phase, Math.floor(100 * a.fraction) + ' %'];
    if (r.layers) words.push(a.layers_done + ' of ' + r.layers + ' layers');
    if (r.layers_per_s > 0) words.push(figure(r.layers_per_s) + '/s');
    if (r.eta_s !== null) words.push(duration(r.eta_s) + ' left');
    if (r.cancel_wanted) words.push('cancelling');
    row.append(name, bar(a.fraction, words.join(' · ')));
    return row;
  }) : [el('p', 'Nothing runs.', 'dim')]));
  const s = o.settings;
  facts($('farm'), [
    ...o.services.map((v) => ['Service', v.engine + ' on ' + v.host + ', process ' + v.pid + ', ' + v.cores + ' cores: ' + (v.doing || 'working')]),
    ['Night window', s.night === 'off' ? '' : s.night],
    ...o.disks.map((d) => ['Free for the ' + d.what, bytes(d.free_bytes) + ' of ' + bytes(d.total_bytes)]),
    ['Cache', count(o.cache.entries) + ' results, ' + bytes(o.cache.bytes)],
    ['Attempts', count(o.attempts) + ', ' + count(o.attempts_failed) + ' without a result']]);
  $('when').textContent = 'at ' + new Date(o.now_ms).toLocaleTimeString('en-GB');
}

function jobRows(state, list) {
  const height = state === 'done' || state === 'worst';
  const heads = height ? ['Part', 'what it comes to', 'largest', '95 % within', 'mean', 'lost', 'merged', 'ended', 'report', 'job']
    : state === 'queued' ? ['Part', 'user', 'labels', 'priority', 'ready by', 'submitted', 'why it waits', 'job']
    : ['Part', 'user', 'reason', 'what happened', 'attempts', 'ended', 'job'];
  const words = new Set(['what it comes to', 'user', 'labels', 'why it waits', 'reason', 'what happened']);
  const line = el('tr');
  for (const h of heads) {
    const th = el('th', h, words.has(h) ? 'words' : '');
    th.scope = 'col';
    line.append(th);
  }
  $('head').replaceChildren(line);
  $('rows').replaceChildren(...list.map((j) => {
    const row = el('tr'), f = j.figures;
    const first = el('td');
    first.append(jobLink(j.id, j.name));
    row.append(first);
    const cell = (text, kind) => row.append(el('td', text, kind));
    if (height) {
      const h = f && f.height_error_um, v = f && f.verdict;
      cell(v ? v.words : '', 'words' + (v && v.outcome === 'fails' ? ' bad' : v && v.outcome === 'look' ? ' warn' : ''));
      if (f && !h) {
        // A tomographic print has no heights.
        const td = el('td', tomoWords(f), f.feasible ? '' : 'bad');
        td.colSpan = 5;
        row.append(td);
      } else {
        for (const v of h ? [h.max_abs, h.p95_abs, h.mean_abs] : ['', '', '']) cell(v === '' ? '-' : um(v));
        cell(f ? count(f.lost_features) : '-', f && f.lost_features ? 'bad' : '');
        cell(f ? count(f.merged_features) : '-', f && f.merged_features ? 'bad' : '');
      }
      cell(moment(j.ended_ms));
      const td = el('td');
      if (j.files.some((x) => x.ending === 'html')) td.append(reportLink(j));
      row.append(td);
    } else if (state === 'queued') {
      cell(j.user, 'words');
      cell(j.labels.join(', '), 'words');
      cell(j.priority);
      cell(j.ready_by_ms === null ? '' : minute(j.ready_by_ms));
      cell(moment(j.submitted_ms));
      cell([j.follows ? 'job ' + j.follows + ' does the same work' : '', j.reason ? 'again after ' + j.reason : ''].filter(Boolean).join('; '), 'words');
    } else {
      cell(j.user, 'words');
      cell(j.reason, 'words');
      cell(plain(j.message), 'words message');
      cell(j.attempts);
      cell(moment(j.ended_ms));
    }
    cell(j.id);
    return row;
  }));
}

function timeWords(f) {
  if (f.light_s === undefined) return '';
  if (f.print_time_s === null) return duration(f.light_s) + ' of light, lifts not known';
  return duration(f.print_time_s) + (f.light_s < f.print_time_s ? ', of it ' + duration(f.light_s) + ' of light' : '');
}
function tomoWords(f) {
  return 'contrast ' + (f.contrast === null ? 'without bound' : figure(f.contrast)) + ', VER ' + figure(f.ver)
    + ', prints in ' + duration(f.print_time_s) + (f.feasible ? '' : '; misses');
}

const reportLink = (j) => link('api/v1/jobs/' + j.id + '/files/html', 'open', 'open the report of ' + j.name);

async function table() {
  const mine = ++asked, state = document.querySelector('input[name=state]:checked').value;
  const order = {queued: 'urgency', worst: 'worst'}[state] || 'ended';
  const q = new URLSearchParams({state: state === 'worst' ? 'done' : state, order, limit: pageSize, offset});
  for (const [key, id] of [['text', 'find'], ['user', 'user'], ['label', 'label']]) if ($(id).value) q.set(key, $(id).value);
  const page = await read('api/v1/jobs?' + q);
  if (mine !== asked) return;  // a later question has been asked
  if (page.jobs.length === 0 && offset > 0) { offset = 0; return table(); }
  jobRows(state, page.jobs);
  const asked_for = $('find').value || $('user').value || $('label').value;
  $('place').textContent = page.total ? count(offset + 1) + ' to ' + count(offset + page.jobs.length) + ' of ' + count(page.total)
    : asked_for ? 'No such jobs.' : state === 'worst' ? 'No job is done.' : 'No job is ' + state + '.';
  $('head').hidden = page.total === 0;
  $('back').hidden = $('on').hidden = page.total <= pageSize;
  $('back').disabled = offset === 0;
  $('on').disabled = offset + page.jobs.length >= page.total;
}

async function showJob(id, go) {
  const j = await read('api/v1/jobs/' + id);
  shown = id;
  $('detail').hidden = false;
  $('detail-title').textContent = 'Job ' + j.id + ': ' + j.name;
  let report = null;
  if (j.files.some((x) => x.ending === 'html')) {
    report = el('dd');
    report.append(reportLink(j));
  }
  facts($('facts'), [['State', j.state + (j.reason ? ' (' + j.reason + ')' : '') + (j.from_cache ? ', from the cache' : '')], ['Message', plain(j.message)],
    ['Parts', j.parts.map((p) => p.split('/').pop()).join(', ')], ['Printer, resin', j.printer + ', ' + j.resin], ['User', j.user], ['Labels', j.labels.join(', ')],
    ['Comes to', j.figures && j.figures.verdict ? j.figures.verdict.words : ''], ['Print', j.figures ? (j.figures.height_error_um ? timeWords(j.figures) : tomoWords(j.figures)) : ''], ['Priority', String(j.priority)], ['Ready by', j.ready_by_ms === null ? '' : minute(j.ready_by_ms)],
    ['Submitted', moment(j.submitted_ms)], ['Ended', j.ended_ms ? moment(j.ended_ms) : ''], ['Report', report], ['After scans', afterScans(j)]]);
  jobActions(j);
  await jobScans(j, may('operate') || (may('submit') && j.user === me.name));
  $('tries').replaceChildren(...j.tries.map((a) => el('p', 'Attempt ' + a.number + ', ' + a.engine + (a.node ? ' on ' + a.node : '') + ', ' + moment(a.started_ms) + ': '
    + (a.ended_ms ? (a.reason || 'done') + ' after ' + duration((a.ended_ms - a.started_ms) / 1000) + (a.message ? ', ' + plain(a.message) : '') : a.phase))));
  $('log').textContent = j.tries.length ? plain(await (await ask('api/v1/jobs/' + id + '/log?bytes=20000')).text()) : 'not tried yet';
  if (go) $('detail-title').focus();
}

async function events() {
  const list = (await read('api/v1/events?limit=15')).events;
  $('events').replaceChildren(...list.reverse().map((e) => {
    const line = el('li', undefined, e.kind);
    line.append(el('span', moment(e.at_ms), 'dim'), ' ');
    if (e.job) line.append(jobLink(e.job, e.job + ' ' + e.name), ' ');
    line.append([e.kind.replaceAll('_', ' '), e.reason ? '(' + e.reason + ')' : '', e.text ? '· ' + e.text : ''].filter(Boolean).join(' '));
    return line;
  }));
  if (!list.length) $('events').append(el('li', 'Nothing has happened yet.', 'dim'));
}

async function timeline() {
  const url = await blobUrl('api/v1/timeline.svg');
  // What is newest can be seen, also where the picture is wider than the window.
  if (!timelineUrl) $('timeline').addEventListener('load', () => { const box = $('timeline').closest('.scroll'); box.scrollLeft = box.scrollWidth; }, {once: true});
  $('timeline').src = url;
  if (timelineUrl) URL.revokeObjectURL(timelineUrl);
  timelineUrl = url;
}

let drawn = 0;
async function look() {
  const o = await read('api/v1/overview');
  overview(o);
  farmActions(o);
  if (o.last_event !== lastEvent) {
    lastEvent = o.last_event;
    await Promise.all([table(), events(), wander(), shown ? showJob(shown, false) : null]);
  }
  if (Date.now() - drawn > 15000) {
    drawn = Date.now();
    await timeline();
    await bridges();
  } else if (bridgeList.some((b) => b.state && b.state.running)) {
    await bridges();
  }
}
async function tick() {
  clearTimeout(timer);
  try {
    await look();
    // A complaint about a click stays until the next; that the farm does not answer goes when it does.
    if (lost) { lost = false; calm(); }
  } catch (e) { lost = true; tell(e); }
  if (!document.hidden) timer = setTimeout(tick, 2000);
}
let lost = false;

const again = () => { offset = 0; table().catch(tell); };
$('states').addEventListener('change', () => { chosen = true; again(); });
for (const id of ['find', 'user', 'label']) $(id).addEventListener('input', again);
$('back').addEventListener('click', () => { offset = Math.max(0, offset - pageSize); table().catch(tell); });
$('on').addEventListener('click', () => { offset += pageSize; table().catch(tell); });
document.addEventListener('visibilitychange', () => { if (!document.hidden && timer) tick(); });
begin(async () => {
  lastEvent = -1;
  drawn = 0;
  await look();
  clearTimeout(timer);
  timer = setTimeout(tick, 2000);
});
