"use strict";
// Pages from the disk may not fetch files, so the index is a script that is loaded when somebody searches.
(() => {
  const input = document.getElementById("search"), found = document.getElementById("found");
  const menu = document.getElementById("menu"), pages = document.getElementById("pages");
  const most = 20;
  let index = null, chosen = -1;

  menu.addEventListener("click", () => {
    const open = pages.classList.toggle("open");
    menu.setAttribute("aria-expanded", String(open));
  });

  const load = () => {
    if (index) return Promise.resolve();
    return new Promise((done) => {
      const script = document.createElement("script");
      script.src = "search-index.js";
      script.onload = () => {
        index = [];
        for (const page of searchIndex) {
          page.sections.forEach(([anchor, heading, text], place) => index.push({
            page: page.page, title: page.title, anchor, heading, text, first: place === 0,
            titleWords: page.title.toLowerCase(), headingWords: heading.toLowerCase(), words: text.toLowerCase(),
          }));
        }
        done();
      };
      script.onerror = () => { found.hidden = false; found.innerHTML = "<p>The index can't be read.</p>"; };
      document.head.append(script);
    });
  };

  // Words begin where letters do; "fit-mm" is found as typed, too.
  const begins = (text, word) => {
    for (let at = text.indexOf(word); at >= 0; at = text.indexOf(word, at + 1)) {
      if (at === 0 || !/[\p{L}\p{N}]/u.test(text[at - 1]) || !/[\p{L}\p{N}]/u.test(word[0])) return at;
    }
    return -1;
  };
  const score = (s, words) => {
    let sum = 0;
    for (const word of words) {
      const inTitle = begins(s.titleWords, word) >= 0, inHeading = begins(s.headingWords, word) >= 0;
      let times = 0;
      for (let at = s.words.indexOf(word); at >= 0 && times < 8; at = s.words.indexOf(word, at + word.length)) ++times;
      const inText = begins(s.words, word) >= 0;
      if (!inTitle && !inHeading && !inText) return 0;
      sum += (inTitle ? (s.first ? 30 : 8) : 0) + (inHeading ? 20 : 0) + (inText ? 2 + times : 0);
    }
    // What changed once has every word, and is seldom what is looked for.
    return s.page === "changelog.html" ? sum / 4 : sum;
  };
  const escape = (text) => text.replace(/[&<>"]/g, (c) => ({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"}[c]));
  const marked = (text, words) => {
    const pattern = words.map((w) => escape(w).replace(/[.*+?^${}()|[\]\\]/g, "\\$&")).join("|");
    return escape(text).replace(new RegExp(pattern, "gi"), (m) => `<mark>${m}</mark>`);
  };
  const around = (s, words) => {
    const places = words.map((w) => begins(s.words, w)).filter((at) => at >= 0);
    const at = places.length ? Math.min(...places) : 0;
    const from = Math.max(0, s.text.lastIndexOf(" ", at - 60));
    return (from > 0 ? "… " : "") + s.text.slice(from, from + 170).trim() + (from + 170 < s.text.length ? " …" : "");
  };

  const choose = (n) => {
    const links = [...found.querySelectorAll("a")];
    if (!links.length) return;
    chosen = (n + links.length) % links.length;
    links.forEach((a, i) => a.setAttribute("aria-selected", String(i === chosen)));
    links[chosen].scrollIntoView({block: "nearest"});
  };
  const search = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    chosen = -1;
    if (!words.length) { found.hidden = true; return; }
    const hits = index.map((s) => [score(s, words), s]).filter(([n]) => n > 0);
    hits.sort((a, b) => b[0] - a[0]);
    found.hidden = false;
    found.innerHTML = hits.length ? hits.slice(0, most).map(([, s]) =>
      `<a role="option" href="${s.page}#${encodeURIComponent(s.anchor)}"><b>${marked(s.heading, words)}</b>` +
      (s.first ? "" : ` · ${escape(s.title)}`) + `<small>${marked(around(s, words), words)}</small></a>`).join("") +
      (hits.length > most ? `<p>${hits.length - most} more</p>` : "") : "<p>Nothing found</p>";
  };

  input.addEventListener("input", () => load().then(search));
  input.addEventListener("focus", () => load().then(() => { if (input.value) search(); }));
  input.form.addEventListener("submit", (e) => {
    e.preventDefault();
    const links = found.querySelectorAll("a");
    if (links.length) { location.href = links[Math.max(0, chosen)].href; found.hidden = true; }
  });
  input.addEventListener("keydown", (e) => {
    if (e.key === "ArrowDown") { e.preventDefault(); choose(chosen + 1); }
    if (e.key === "ArrowUp") { e.preventDefault(); choose(chosen - 1); }
    if (e.key === "Escape") { found.hidden = true; input.blur(); }
  });
  document.addEventListener("keydown", (e) => {
    if (e.key === "/" && !/^(INPUT|TEXTAREA)$/.test(document.activeElement.tagName)) { e.preventDefault(); input.focus(); }
  });
  // index.html?q=words shows what they find.
  const asked = new URLSearchParams(location.search).get("q");
  if (asked) { input.value = asked; load().then(search); }
  document.addEventListener("click", (e) => { if (!e.target.closest(".search")) found.hidden = true; });
})();
