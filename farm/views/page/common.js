'use strict';
// What all pages of the farm share. Everything that comes from the farm goes into a page as text, never as markup.
const $ = (id) => document.getElementById(id);
const el = (name, text, kind) => {
  const e = document.createElement(name);
  if (text !== undefined) e.textContent = text;
  if (kind) e.className = kind;
  return e;
};
function button(words, action, kind) {
  const b = el('button', words, kind);
  b.type = 'button';
  b.addEventListener('click', () => { clear(); const done = action(); if (done instanceof Promise) done.catch((e) => tell(e, b)); });
  return b;
}

const count = (n) => Number(n).toLocaleString('en-US');
function bytes(n) {
  if (!(n >= 0)) return '-';
  const units = ['B', 'kB', 'MB', 'GB', 'TB'];
  let u = 0;
  while (n >= 999.95 && u < 4) { n /= 1000; u++; }
  return (u ? n.toFixed(1) : n) + ' ' + units[u];
}
function duration(s) {
  if (s === null || !(s >= 0)) return '-';
  if (s < 10) return s.toFixed(1) + ' s';
  s = Math.round(s);
  const two = (n) => String(n).padStart(2, '0');
  if (s < 60) return s + ' s';
  if (s < 3600) return Math.floor(s / 60) + ' min ' + two(s % 60) + ' s';
  if (s < 172800) return Math.floor(s / 3600) + ' h ' + two(Math.floor(s / 60) % 60) + ' min';
  return Math.floor(s / 86400) + ' d ' + two(Math.floor(s / 3600) % 24) + ' h';
}
function moment(ms) {
  if (!ms) return '-';
  const d = new Date(ms), time = d.toLocaleTimeString('en-GB');
  return Math.abs(Date.now() - ms) < 43200000 ? time : d.toLocaleDateString('en-CA') + ' ' + time.slice(0, 5);
}
const minute = (ms) => moment(ms).replace(/:\d\d$/, (s, at, all) => all.length === 8 ? '' : s);
// Three digits that count, and never an exponent.
const figure = (v) => Math.abs(v) >= 999.5 ? count(Math.round(v))
  : Number(v.toPrecision(3)).toLocaleString('en-US', {maximumFractionDigits: 9});
const um = (v) => figure(v) + ' um';

// --- asking the server ----------------------------------------------------------------------------------------------

const token = () => sessionStorage.getItem('token');
const bearer = () => (token() ? {Authorization: 'Bearer ' + token()} : {});

// The answer, or an Error with what the server says. `body`: sent as JSON.
async function ask(path, body, method) {
  const options = {headers: bearer()};
  if (body !== undefined) {
    options.method = method || 'POST';
    options.headers['Content-Type'] = 'application/json';
    options.body = JSON.stringify(body);
  }
  const answer = await fetch(path, options);
  if (answer.ok) return answer;
  if (answer.status === 401) {
    $('ask').hidden = false;
    if (body === undefined) $('all').hidden = true;
    const was = token();
    // A token that holds no more, as when the farm's accounts changed.
    if (was) sessionStorage.removeItem('token');
    throw new Error(was ? 'Your token is none of this farm’s any more. Sign in again.'
      : body === undefined ? 'This farm is shown to those who have its token.' : 'Sign in with your token to do that.');
  }
  let words = 'The farm answers ' + answer.status + '.', errors = [];
  try {
    const e = (await answer.json()).error;
    errors = e.errors || [];
    words = e.errors ? e.errors.map((x) => x.message).join('; ') : e.message;
  } catch { /* no JSON: the status has to do */ }
  const error = new Error(sentence(pageWords(words)));
  error.errors = errors;
  throw error;
}
const sentence = (words) => words.charAt(0).toUpperCase() + words.slice(1) + (/[.!?]$/.test(words) ? '' : '.');
const read = async (path) => (await ask(path)).json();
const change = async (path, body = {}) => (await ask(path, body)).json();

// A path of the server as an address: all pages lie at its root, which a proxy may show under a path of its own.
const here = (path) => new URL('.' + path, document.baseURI).href;

// A picture or a file as an address that this page may show.
async function blobUrl(path) { return URL.createObjectURL(await (await ask(path)).blob()); }

// A link that works for those who have a token, too: a browser sends none when it follows a link, so the server gives a
// ticket for this one.
function link(path, words, label, download) {
  const a = el('a', words);
  a.href = path;
  if (!download) { a.target = '_blank'; a.rel = 'noopener'; }
  if (label) a.setAttribute('aria-label', label);
  a.addEventListener('click', (event) => {
    if (!token()) return;
    event.preventDefault();
    const tab = download ? window : window.open('about:blank');
    if (tab && !download) tab.opener = null;
    const [bare, query] = path.split('?');
    change('api/v1/tickets', {path: '/' + bare}).then((t) => { tab.location.href = here(t.path + (query ? '&' + query : '')); }, tell);
  });
  return a;
}

// --- the page's own words ---------------------------------------------------------------------------------------------

// What is wrong with a field of the page: its message stands there.
class FieldError extends Error {
  constructor(field, words) { super(words); this.field = field; }
}
// Says what went wrong where the person looks: at the field that `error` names, else after `near`, a button or a box; else
// above. Readers of screens say it at once, and it is scrolled into sight.
function tell(error, near) {
  const words = error instanceof TypeError ? 'The farm’s server does not answer.' : error.message || String(error);
  const field = error.field || null;
  clear();
  if (!field && !(near instanceof Node && near.isConnected)) {
    $('trouble').textContent = words;
    $('trouble').hidden = false;
    $('trouble').scrollIntoView({block: 'nearest'});
    return;
  }
  const said = el('p', words, 'holds');
  said.id = 'said-here';
  said.setAttribute('role', 'alert');
  if (field) {
    for (let box = field.closest('details'); box; box = box.parentElement.closest('details')) box.open = true;
    field.setAttribute('aria-invalid', 'true');
    field.setAttribute('aria-errormessage', said.id);
    (field.closest('label') || field).after(said);
    field.focus({preventScroll: true});
  } else if (near.matches('button')) (near.closest('.controls') || near).after(said);
  else near.append(said);
  said.scrollIntoView({block: 'center'});
}
function calm() { $('trouble').hidden = true; }
// What was said at a field or a button stays until the person does something else.
function clear() {
  calm();
  const said = $('said-here');
  if (said) said.remove();
  for (const e of document.querySelectorAll('[aria-invalid]')) { e.removeAttribute('aria-invalid'); e.removeAttribute('aria-errormessage'); }
}

// One sign-in for all tabs of this browser, for as long as one of them is open: tabs ask each other, nothing is kept.
const tabs = typeof BroadcastChannel === 'function' ? new BroadcastChannel('slicecorr-farm') : null;
let signedIn = () => {};
if (tabs) {
  tabs.onmessage = ({data}) => {
    if (data.want && token()) tabs.postMessage({token: token()});
    else if (data.token && !token()) { sessionStorage.setItem('token', data.token); signedIn(); }
    else if (data.out && token()) { sessionStorage.removeItem('token'); location.reload(); }
  };
}
// Waits for what other tabs say, a moment.
function tokenOfOtherTabs() {
  if (!tabs || token()) return Promise.resolve();
  return new Promise((done) => { signedIn = done; tabs.postMessage({want: true}); setTimeout(done, 150); });
}

let me = {name: '', role: 'look'};
const may = (role) => ['look', 'submit', 'operate'].indexOf(me.role) >= ['look', 'submit', 'operate'].indexOf(role);

// Asks who we are, and begins; again after signing in.
async function begin(start) {
  const go = async () => {
    delete document.body.dataset.ready;
    try {
      me = await read('api/v1/me');
      calm();
      $('ask').hidden = true;
      $('all').hidden = false;
      $('who').replaceChildren(token() ? (me.name || 'token') + ' may ' + me.role + ' ' : 'anybody may look ',
        button(token() ? 'Sign out' : 'Sign in', () => {
          if (token()) { sessionStorage.removeItem('token'); if (tabs) tabs.postMessage({out: true}); location.reload(); return; }
          $('ask').hidden = false;
          $('token').focus();
        }));
      for (const e of document.querySelectorAll('[data-role]')) e.hidden = !may(e.dataset.role);
      for (const e of document.querySelectorAll('[data-only-look]')) e.hidden = may('submit');
      await start();
      document.body.dataset.ready = 'yes';
    } catch (e) { tell(e); }
  };
  $('ask').addEventListener('submit', async (event) => {
    event.preventDefault();
    const typed = $('token').value.trim();
    clear();
    try {
      if (!typed) throw new FieldError($('token'), 'Enter your token.');
      const answer = await fetch('api/v1/me', {headers: {Authorization: 'Bearer ' + typed}});
      if (answer.status === 401) throw new FieldError($('token'), 'This token is none of this farm’s. Look whether a letter is missing, or ask who runs the farm.');
    } catch (e) { tell(e, $('ask')); return; }
    sessionStorage.setItem('token', typed);
    $('token').value = '';
    if (tabs) tabs.postMessage({token: typed});
    go();
  });
  await tokenOfOtherTabs();
  signedIn = go;
  await go();
}

// What programs say, in the words of a page.
let pageWords = (text) => text;

// Starts a study and follows it to its end; `box` says how far it is, with a button to cancel it. `at`: what it is asked of.
async function study(request, box, at = 'api/v1/studies') {
  let s = await change(at, request);
  const words = el('span', '', 'dim'), stop = button('Cancel', () => change('api/v1/studies/' + s.study + '/cancel'));
  box.replaceChildren(words, ' ', stop);
  while (s.state === 'waiting' || s.state === 'running') {
    words.textContent = s.state === 'waiting' ? (s.before ? count(s.before) + ' before this one' : 'about to begin')
      : s.stage + ', ' + duration(s.seconds);
    await new Promise((done) => setTimeout(done, 250));
    s = await read('api/v1/studies/' + s.study);
  }
  box.replaceChildren();
  if (s.state === 'cancelled') { box.append(el('span', 'Cancelled.', 'dim')); return null; }
  if (s.state === 'failed') {
    tell(new Error((s.exit_code === 3 ? 'This can’t be printed: ' : '') + pageWords(s.message)), box);
    return null;
  }
  return {...s, path: 'api/v1/studies/' + s.study};
}

// --- parts of pages -----------------------------------------------------------------------------------------------------

// Files go by their names, not by where the farm keeps them: folders before a name are left out.
const plain = (text) => String(text || '').replace(/(^|[\s'"(,:=])(?:\/[^\s/'",:()]+)+\/(?=[^\s/'",:()])/g, '$1');

function facts(list, pairs) {
  list.replaceChildren();
  for (const [name, value] of pairs) {
    if (value === '' || value === null || value === undefined) continue;
    list.append(el('dt', name), value instanceof Node ? value : el('dd', value));
  }
}

function bar(fraction, words) {
  const p = el('div', undefined, 'progress');
  p.setAttribute('role', 'progressbar');
  p.setAttribute('aria-valuenow', Math.round(100 * fraction));
  p.setAttribute('aria-label', words);
  const i = el('i');
  i.style.width = 100 * fraction + '%';
  p.append(i, el('b', words));
  return p;
}

// A table of rows of texts; the first row is its head, the first cell of a row names it.
function tableOf(rows, caption) {
  const t = el('table'), head = el('thead'), body = el('tbody');
  if (caption) t.append(el('caption', caption));
  rows.forEach((cells, n) => {
    const line = el('tr');
    cells.forEach((c, i) => {
      const cell = el(n === 0 || i === 0 ? 'th' : 'td');
      if (n === 0 || i === 0) cell.scope = n === 0 ? 'col' : 'row';
      cell.append(c instanceof Node ? c : String(c));
      line.append(cell);
    });
    (n === 0 ? head : body).append(line);
  });
  t.append(head, body);
  const box = el('div', undefined, 'scroll');
  box.tabIndex = 0;
  box.setAttribute('role', 'region');
  box.setAttribute('aria-label', caption || 'Table');
  box.append(t);
  return box;
}
