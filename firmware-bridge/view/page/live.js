'use strict';
// The state each second, the record now and then and when the print changes its phase.
(() => {
  const by = id => document.getElementById(id);
  const stateMs = 1000, recordMs = 10000;
  let token = '', recordAt = 0, recordOf = '';

  const number = (v, digits) => typeof v === 'number' && isFinite(v) ? v.toFixed(digits) : '-';
  const count = v => typeof v === 'number' ? String(v).replace(/\B(?=(\d{3})+$)/g, ',') : '-';
  const duration = s => {
    if (typeof s !== 'number' || !isFinite(s) || s < 0) return '-';
    if (s < 10) return s.toFixed(1) + ' s';
    const n = Math.round(s), two = v => String(v).padStart(2, '0');
    if (n < 60) return n + ' s';
    return n < 3600 ? `${Math.floor(n / 60)} min ${two(n % 60)} s` : `${Math.floor(n / 3600)} h ${two(Math.floor(n / 60) % 60)} min`;
  };

  async function get(path) {
    const headers = token ? { Authorization: 'Bearer ' + token } : {};
    const answer = await fetch(path, { headers, cache: 'no-store', credentials: 'omit' });
    if (answer.status === 401 || answer.status === 403) {
      by('ask').hidden = false;
      throw new Error('this server asks for a token');
    }
    if (!answer.ok) throw new Error('the server answers ' + answer.status);
    by('ask').hidden = true;
    return answer;
  }

  function tile(value, what, kind) {
    const box = document.createElement('div'), b = document.createElement('b'), span = document.createElement('span');
    box.className = 'tile ' + (kind || '');
    b.textContent = value;
    span.textContent = what;
    box.append(b, span);
    return box;
  }

  function show(s) {
    const failed = s.fault && s.fault !== 'none', layers = s.mode === 'layerwise', turns = s.angles > 0;
    const name = String(s.stack || '').split('/').pop();
    by('title').textContent = `${s.printer}: ${s.running ? s.phase || 'a print begins' : 'no print runs'}`;
    document.title = by('title').textContent;
    by('when').textContent = name ? (s.running ? name : 'the last: ' + name) : '';
    const trouble = failed ? `${s.fault}: ${s.detail}. To do: ${s.to_do || ''}${s.latched && !s.running ? ', then printbridge reset' : ''}` : '';
    const left = s.after_fault && !s.after_fault.confirmed ? s.after_fault.text : '';
    by('alarm').textContent = left;
    by('alarm').hidden = !left;
    by('trouble').textContent = trouble;
    by('trouble').hidden = !trouble;
    const share = s.frames > 0 ? (s.frames_shown || 0) / s.frames : 0, whole = by('whole');
    whole.querySelector('i').style.width = 100 * share + '%';
    whole.querySelector('b').textContent = s.frames ? `${count(s.frames_shown)} of ${count(s.frames)} frames shown` + (s.running ? `, ${duration(s.at_s)} elapsed, ${duration(s.left_s)} left` : '') : '';
    whole.setAttribute('aria-valuenow', Math.floor(100 * share));
    const tiles = [];
    if (s.phase) {
      if (turns) {
        tiles.push(tile(number(s.angle_in_turn_deg, 1) + '°', s.turn_in_words));
        tiles.push(tile(number(s.speed_deg_s, 2), `°/s, planned ${number(s.planned_speed_deg_s, 2)}`));
        tiles.push(failed ? tile(number(s.worst_stage_error_deg, 3) + '°', `largest stage error until the fault, ${number(s.tolerance_deg, 2)}° borne`)
          : tile(number(s.stage_error_deg, 3) + '°', `stage error, ${number(s.worst_stage_error_deg, 3)}° at most, ${number(s.tolerance_deg, 2)}° borne`));
      } else {
        tiles.push(tile(number(s.z_um / 1000, 3) + ' mm', 'z'));
        if (!layers) tiles.push(tile(number(s.speed_um_s * 3.6, 1), `mm/h, planned ${number(s.planned_speed_um_s * 3.6, 1)}`));
        tiles.push(failed ? tile(number(s.worst_stage_error_um, 2) + ' um', 'largest stage error until the fault')
          : tile(number(s.stage_error_um, 2) + ' um', `stage error, ${number(s.worst_stage_error_um, 2)} um at most`));
      }
      const stale = s.after_fault && !s.after_fault.heard;
      tiles.push(tile(stale ? 'not measured' : number(s.blue_measured * 100, 1) + ' %', `blue light, ${number(s.blue_share * 100, 1)} % asked`));
      if (s.uv) tiles.push(tile(stale ? 'not measured' : number(s.uv_measured, 2), `mW/cm² UV light, ${number(s.uv_mw_cm2, 2)} asked`));
      const worst = of => of ? of.worst : undefined;
      if (turns) tiles.push(tile(number(s.latest_um / s.um_per_deg, 3) + '°', `latest frame, ${number(s.latest_um, 1)} um at the wall, ${number(s.max_late_deg, 2)}° borne`));
      else if (layers) tiles.push(tile(number(worst(s.lateness_ms), 2) + ' ms', 'longest exposure too long by'));
      else tiles.push(tile(number(s.latest_um, 2) + ' um', 'latest frame'));
      tiles.push(tile(String(s.late_frames), 'late', s.late_frames > 0 ? 'bad' : ''));
      if (s.temperature_c !== null) tiles.push(tile(number(s.temperature_c, 1) + ' °C', 'temperature'));
      if (s.running) tiles.push(tile(String(s.ready_frames), `frames ready, of ${s.ring_frames}`));
      tiles.push(tile(String(s.missed_cycles), 'cycles missed'));
    }
    by('tiles').replaceChildren(...tiles);
    by('all').hidden = false;
  }

  async function look() {
    try {
      const s = await (await get('status.json')).json();
      show(s);
      const of = [s.running, s.phase, s.stack, s.latched].join(' ');
      const now = Date.now();
      if (of !== recordOf || (s.running && now - recordAt > recordMs)) {
        recordOf = of;
        recordAt = now;
        by('record').innerHTML = await (await get('record')).text();
        by('record-when').textContent = 'as of ' + new Date(now).toLocaleTimeString();
      }
    } catch (e) {
      by('trouble').textContent = e.message;
      by('trouble').hidden = false;
    }
    setTimeout(look, stateMs);
  }
  by('ask').addEventListener('submit', e => {
    e.preventDefault();
    token = by('token').value;
  });
  look();
})();
