'use strict';
// Files that are dropped or chosen and go to the server, one after the other, with progress.

// Sends one file; `progress` gets the share that is there. Gives "upload:TOKEN/NAME"; `hold.abort` ends it.
function upload(file, progress, hold) {
  return new Promise((done, failed) => {
    const request = new XMLHttpRequest();
    hold.abort = () => request.abort();
    // Names of files that the server would refuse are made such as it takes.
    const name = file.name.replace(/^[.-]+/, '').replace(/[\u0000-\u001f\u007f/\\]/g, '_').slice(-150) || 'part';
    request.open('PUT', 'api/v1/parts/' + encodeURIComponent(name));
    if (token()) request.setRequestHeader('Authorization', 'Bearer ' + token());
    request.upload.addEventListener('progress', (e) => progress(e.loaded / Math.max(1, e.total)));
    request.addEventListener('load', () => {
      let answer = {};
      try { answer = JSON.parse(request.responseText); } catch { /* the status has to do */ }
      if (request.status === 201) return done(answer.part);
      failed(new Error(answer.error ? answer.error.message : 'The farm answers ' + request.status + '.'));
    });
    request.addEventListener('error', () => failed(new TypeError('no answer')));
    request.addEventListener('abort', () => failed(new Error('taken out')));
    request.send(file);
  });
}

// A place to drop files at, and the list of them. `changed` is called when a file is there, or gone.
// `endings`: a test of names; `own`, where given, makes fields for a part of several.
class Parts {
  constructor(drop, input, list, endings, changed, own) {
    Object.assign(this, {list, endings, changed, own, items: [], busy: false});
    input.addEventListener('change', () => { this.add(input.files); input.value = ''; });
    for (const name of ['dragenter', 'dragover']) drop.addEventListener(name, (e) => { e.preventDefault(); drop.classList.add('over'); });
    for (const name of ['dragleave', 'drop']) drop.addEventListener(name, (e) => { e.preventDefault(); drop.classList.remove('over'); });
    drop.addEventListener('drop', (e) => this.add(e.dataTransfer.files));
  }

  get there() { return this.items.filter((i) => i.part); }

  add(files) {
    for (const file of files) {
      const row = el('div', undefined, 'part'), item = {file, name: file.name, row, part: ''};
      item.bar = bar(0, 'waiting');
      row.append(el('span', file.name + ', ' + bytes(file.size), 'name'), item.bar, button('Remove', () => this.remove(item)));
      row.lastChild.setAttribute('aria-label', 'Remove ' + file.name);
      item.own = this.ownFields(item);
      if (item.own) row.append(item.own.box);
      this.list.append(row);
      this.items.push(item);
      if (!this.endings.test(file.name)) this.say(item, 0, 'not sent: no part that is known by its name', true);
    }
    this.send();
  }

  // What one part of several has of its own; null where the page asks for nothing.
  ownFields(item) { return this.own ? this.own(item) : null; }

  say(item, fraction, words, ended) {
    const next = bar(fraction, words);
    item.bar.replaceWith(next);
    item.bar = next;
    if (ended) item.ended = true;
  }

  remove(item) {
    if (item.hold) item.hold.abort();
    this.items = this.items.filter((i) => i !== item);
    item.row.remove();
    this.changed();
  }

  async send() {
    if (this.busy) return;
    this.busy = true;
    for (let item; (item = this.items.find((i) => !i.part && !i.ended));) {
      item.hold = {};
      try {
        item.part = await upload(item.file, (f) => this.say(item, f, Math.floor(100 * f) + ' %'), item.hold);
        this.say(item, 1, 'there', true);
      } catch (e) {
        this.say(item, 0, 'not sent: ' + (e instanceof TypeError ? 'the server does not answer' : e.message), true);
      }
      this.changed();
    }
    this.busy = false;
  }
}
