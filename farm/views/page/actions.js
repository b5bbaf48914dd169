'use strict';
// What may be done with a job, with the farm and with machines: for those who may.
let bridgeList = [];

// The next look at the farm comes at once.
async function act(path, body) {
  calm();
  const answer = await change(path, body);
  await look();
  return answer;
}

function jobActions(j) {
  const at = 'api/v1/jobs/' + j.id, box = $('job-actions');
  // What somebody types stays while the farm is looked at again.
  if (box.contains(document.activeElement) && box.dataset.job === String(j.id) + j.state) return;
  box.dataset.job = String(j.id) + j.state;
  box.replaceChildren();
  const own = may('operate') || (may('submit') && j.user === me.name);
  if (own && (j.state === 'queued' || j.state === 'running')) box.append(button('Cancel this job', () => act(at + '/cancel')));
  if (own && (j.state === 'failed' || j.state === 'cancelled')) box.append(button('Try again', () => act(at + '/retry')));
  if (may('operate') && j.state === 'queued') {
    const priority = el('input'), time = el('input');
    priority.type = 'number';
    priority.value = j.priority;
    priority.size = 5;
    time.type = 'time';
    if (j.ready_by_ms !== null) time.value = new Date(j.ready_by_ms).toLocaleTimeString('en-GB').slice(0, 5);
    const named = (words, input) => { const l = el('label', words + ' '); l.append(input); return l; };
    box.append(named('Priority', priority), named('Ready by', time),
      button('Set', () => act(at + '/priority', {priority: Number(priority.value), ready_by: time.value || 'none'})),
      button('Before all others', async () => {
        const first = (await read('api/v1/jobs?state=queued&order=urgency&limit=1')).jobs[0];
        if (first && first.id !== j.id) await act(at + '/priority', {priority: first.priority + 1});
      }));
  }
  if (j.state !== 'done') return;
  for (const f of j.files) {
    if (f.ending === 'html') continue;
    const words = 'Download ' + f.ending.replace(/^-/, '') + ' (' + bytes(f.bytes) + ')';
    box.append(link(at + '/files/' + f.ending, words, words + ' of ' + j.name, true));
  }
  const fitting = bridgeList.filter((b) => b.printer === j.printer);
  if (!may('operate') || !fitting.length) return;
  const which = el('select'), dry = el('input'), clear = el('input');
  which.append(...fitting.map((b) => new Option(b.name, b.name)));
  which.setAttribute('aria-label', 'Machine');
  dry.type = clear.type = 'checkbox';
  const boxed = (input, words) => { const l = el('label'); l.append(input, ' ' + words); return l; };
  const said = el('span', '', 'dim');
  box.append(which, boxed(dry, 'without light'), boxed(clear, 'I looked: no part is on the machine'),
    button('Print it', async () => {
      said.textContent = 'asking the machine';
      try {
        const r = await act(at + '/print', {bridge: which.value, dry_run: dry.checked, machine_is_clear: clear.checked});
        said.textContent = r.running ? 'It prints.' : 'Done.';
        if (r.running) said.dataset.bridge = which.value;
      } catch (e) { said.textContent = ''; throw e; } finally { await bridges(); }
    }), said);
}

function farmActions(o) {
  if (!may('operate')) return;
  const paused = o.settings.paused === true || o.settings.paused === 'yes';
  $('farm-actions').replaceChildren(paused ? button('Start jobs again', () => act('api/v1/resume'))
    : button('Start no more jobs', () => act('api/v1/pause')));
}

// What a machine does: in words, and from 0 to 1 where it says so. A print that somebody started ends here, too.
function bridgeWords(b) {
  const s = b.state || {}, part = s.running && s.frames > 0 && s.frame >= 0 ? Math.min(1, s.frame / s.frames) : null;
  const words = [String(s.phase || s.state || b.trouble || 'no print yet').replaceAll('_', ' ')];
  if (part !== null) words.push(Math.floor(100 * part) + ' %', 'slice ' + count(s.frame) + ' of ' + count(s.frames));
  if (s.running && s.left_s >= 0) words.push(duration(s.left_s) + ' left');
  return {part, words: words.join(' · ')};
}

async function bridges() {
  bridgeList = (await read('api/v1/bridges')).bridges;
  for (const said of document.querySelectorAll('[data-bridge]')) {
    const b = bridgeList.find((x) => x.name === said.dataset.bridge), sent = b && b.sent;
    if (!sent || sent.running) { if (b) said.textContent = 'It prints: ' + bridgeWords(b).words + '.'; continue; }
    said.textContent = sent.exit_code === 0 ? 'The print ended well.' : 'The print ended: ' + sent.message;
    delete said.dataset.bridge;
  }
  $('machines').hidden = !bridgeList.length;
  $('bridges').replaceChildren(...bridgeList.map((b) => {
    const box = el('div'), now = bridgeWords(b);
    box.dataset.machine = b.name;
    box.append(el('b', b.name), ' (' + b.printer + '): ' + now.words);
    if (now.part !== null) box.append(bar(now.part, now.words));
    if (may('operate') && b.state && b.state.running) {
      const at = 'api/v1/machines/' + encodeURIComponent(b.name) + '/', row = el('span', undefined, 'controls');
      row.append(button('Stop', () => act(at + 'stop'), 'stop'));
      row.append(b.state.phase === 'paused' ? button('Go on', () => act(at + 'resume')) : button('Pause', () => act(at + 'pause')));
      box.append(row);
    }
    if (b.sent) {
      box.append('; job ' + b.sent.job + ' ' + b.sent.name + (b.sent.by ? ', sent by ' + b.sent.by : '')
        + (b.sent.running ? ', prints' : b.sent.exit_code === 0 ? ', ended well' : ', ended: ' + b.sent.message));
    }
    if (b.page) {
      const a = el('a', 'watch it');
      a.href = b.page;
      a.rel = 'noopener';
      a.target = '_blank';
      box.append(' ', a);
    }
    return box;
  }));
}
$('to-report').append(link('report', 'The report of the last day'));
