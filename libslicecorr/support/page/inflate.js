"use strict";
// What the scripts of all pages use. Arrays that a page carries are deflated and in base 64.
const $ = (id) => document.getElementById(id);
const mix = (a, b, t) => a.map((v, i) => v + (b[i] - v) * t);
const once = (make) => { let kept; return () => (kept ??= make()); };

async function inflate(text) {
  const chars = atob(text);
  const bytes = new Uint8Array(chars.length);
  for (let i = 0; i < chars.length; ++i) bytes[i] = chars.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
