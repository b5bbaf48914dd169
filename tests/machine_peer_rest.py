# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Printers that speak plain HTTP, for machine_peer.py: PrusaLink on an SL1 (OctoPrint's calls), PrusaLink with calls of its
own, OctoPrint with a plug-in for resin, NanoDLP and Odyssey."""

import asyncio
import hashlib
import json
import re
import secrets
import struct
import time
import urllib.parse
import zlib

import machine_peer_http as peer_http

KEY = "abcdefgh"
USES = 30


def picture():
    """A PNG of 2 x 2 grey pixels."""
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 2, 8, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(b"\0\x10\x80\0\x80\xf0")) + chunk(b"IEND", b""))


def quoted(header, name):
    found = re.search(name + r'="?([^",]*)"?', header)
    return found.group(1) if found else ""


def make(kind, machine_class, traps):
    class Rest(machine_class):
        def __init__(self):
            super().__init__(traps)
            self.nonces = {}
            self.plates = {}
            self.later = {}
            self.kept = None
            self.receiving = False
            self.stop_due = None

        def reboot(self):
            self.nonces, self.kept, self.later = {}, None, {}

        # --- who asks

        def let_in(self, request, writer):
            if kind == "octoprint" or self.trap("api-key"):
                sent = request.headers.get("x-api-key") or request.headers.get("authorization", "").removeprefix("Bearer ")
                if sent == KEY:
                    return True
                self.note("wrong key")
                peer_http.answer(writer, 403, b"")
                return False
            header = request.headers.get("authorization", "")
            stale = False
            if header.startswith("Digest "):
                nonce = quoted(header, "nonce")
                realm = quoted(header, "realm")
                md5 = lambda text: hashlib.md5(text.encode()).hexdigest()
                ha1 = md5(f"maker:{realm}:{KEY}")
                ha2 = md5(f"{request.method}:{request.target}")
                count = quoted(header, "nc")
                wanted = md5(f"{ha1}:{nonce}:{count}:{quoted(header, 'cnonce')}:auth:{ha2}")
                right = (quoted(header, "response") == wanted and quoted(header, "uri") == request.target and
                         realm == "prusa-sl1" and quoted(header, "username") == "maker")
                if not right:
                    self.note("wrong digest")
                elif nonce not in self.nonces or self.nonces[nonce] >= USES or self.spring("stale"):
                    stale = True
                    self.note("stale")
                    self.nonces.pop(nonce, None)
                elif int(count, 16) <= self.nonces[nonce]:
                    self.note("nonce used twice")
                else:
                    self.nonces[nonce] = int(count, 16)
                    return True
            nonce = secrets.token_hex(16)
            self.nonces[nonce] = 0
            challenge = f'Digest realm="prusa-sl1", nonce="{nonce}", qop="auth", algorithm=MD5' + (", stale=true" if stale else "")
            peer_http.answer(writer, 401, b"{}", headers=[("WWW-Authenticate", challenge)])
            return False

        async def serve(self, request, reader, writer):
            self.tick()
            self.note("request", method=request.method, target=request.target)
            if kind in ("prusalink", "prusalink-v1", "octoprint"):
                if not self.let_in(request, writer):
                    return
                await self.prusa(request, reader, writer)
            elif kind == "nanodlp":
                await self.nanodlp(request, reader, writer)
            else:
                await self.odyssey(request, reader, writer)

        def lost(self, what, writer):
            """A trap: what was asked is done, and its answer does not come."""
            if self.spring("lose-" + what):
                self.note("answer lost")
                writer.transport.abort()
                return True
            return False

        def json(self, writer, value, status=200, headers=()):
            peer_http.answer(writer, status, json.dumps(value, ensure_ascii=False).encode(), headers=headers)

        # --- PrusaLink and OctoPrint

        def take_file(self, name, data, writer):
            """True: it is there, whole."""
            if self.trap("full"):
                self.json(writer, {"title": "Memory full", "code": "#10516", "message": "no room"}, 409)
                return False
            if name in self.files:
                self.json(writer, {"title": "File exists", "message": "it exists"}, 409)
                return False
            if not name.endswith((".sl1", ".sl1s") if kind != "octoprint" else (".ctb", ".sl1")):
                self.json(writer, {"title": "Unsupported", "message": "no such files"}, 415)
                return False
            if self.trap("junk"):
                return True
            self.files[name] = data
            return True

        def start_file(self, name, writer):
            if name not in self.files:
                self.json(writer, {"title": "Not found"}, 404)
            elif self.trap("not-calibrated"):
                self.json(writer, {"code": "#10113", "title": "Not calibrated", "message": "calibrate it first"}, 409)
            elif self.print or self.spring("busy"):
                self.note("busy")
                self.json(writer, {"code": "#10506", "title": "Busy"}, 409)
            else:
                if not self.trap("start-ignored"):
                    self.begin(name)
                if not self.lost("start", writer):
                    peer_http.answer(writer, 204, b"")

        def steer(self, what, writer):
            if not self.print:
                self.json(writer, {"title": "not printing"}, 409)
                return
            if what == "pause":
                self.ask_pause()
            elif what == "resume":
                self.resume()
            else:
                self.end("stopped")
            peer_http.answer(writer, 204, b"")

        async def prusa(self, request, reader, writer):
            path, method = request.path, request.method
            if self.trap("http-500"):
                return peer_http.answer(writer, 500, b"oops", "text/html")
            if path == "/api/version":
                text = "OctoPrint 1.8" if kind == "octoprint" else "Prusa SLA SL1S"
                more = {"capabilities": {"upload-by-put": True}} if kind == "prusalink-v1" else {}
                return self.json(writer, {"api": "0.1", "server": "1.7.1", "text": text, "hostname": "sl1", **more})
            p = self.print
            run = self.layer() * self.layer_s() if p else 0
            left = (p["layers"] - self.layer()) * self.layer_s() if p else 0
            if path == "/api/v1/status":
                state = ("PAUSED" if p["paused"] else "BUSY" if p["pause_due"] else "PRINTING") if p else (
                    {"finished": "FINISHED", "stopped": "STOPPED"}.get(self.last[1], "IDLE") if self.last else "IDLE")
                if state == "BUSY" and p:
                    state = "PRINTING"
                value = {"printer": {"state": state, "new": 1.5}}
                if p:
                    value["job"] = {"id": int(p["task"].split("-")[1]), "progress": 3.5, "time_remaining": left, "time_printing": run}
                return self.json(writer, value)
            if path == "/api/v1/job":
                if not p:
                    return peer_http.answer(writer, 204, b"")
                return self.json(writer, {"id": 1, "file": {"name": p["name"], "display_name": "Größe",
                                                            "refs": {"thumbnail": "/api/thumbnails/" + p["name"]}}})
            if path.startswith("/api/thumbnails/"):
                return peer_http.answer(writer, 200, picture(), "image/png")
            found = re.fullmatch(r"/api/v1/job/(\d+)(?:/(pause|resume))?", path)
            if found:
                if not p or int(found.group(1)) != int(p["task"].split("-")[1]):
                    return self.json(writer, {"title": "no such job"}, 404)
                return self.steer(found.group(2) or "cancel", writer)
            if path == "/api/printer":
                flags = {"operational": 1, "printing": bool(p and not p["paused"]), "paused": bool(p and p["paused"]),
                         "pausing": bool(p and p["pause_due"]), "cancelling": False, "error": False, "ready": not p,
                         "busy": False, "finished": bool(not p and self.last and self.last[1] == "finished")}
                return self.json(writer, {"state": {"text": "Ä", "flags": flags}, "telemetry": {"tempUvLed": 30}})
            if path == "/api/job" and method == "GET":
                refs = {"thumbnailBig": "http://sl1.local/api/thumbnails/" + p["name"]} if p else {}
                job = {"file": {"name": p["name"], "path": p["name"], "layers": p["layers"], "refs": refs}} if p else {"file": None}
                return self.json(writer, {"job": job, "state": "x", "progress": {"completion": 0.5, "printTime": run, "printTimeLeft": left}})
            if path == "/api/job":
                body = json.loads(await request.body(reader, writer, self))
                what = body["command"] if body["command"] == "cancel" else body.get("action", "toggle")
                return self.steer(what, writer)
            if path == "/api/files/local" and method == "POST":
                body = await request.body(reader, writer, self)
                if body is None:
                    return None
                fields = peer_http.form(request.headers["content-type"], body)
                if list(fields)[-1] != "file" or "print" in fields:
                    return peer_http.answer(writer, 415, b"{}")
                data, name = fields["file"]
                self.note("upload", name=name, bytes=len(data))
                if self.take_file(name, data, writer) and not self.lost("upload", writer):
                    self.json(writer, {"done": True, "files": {"local": {"name": name, "origin": "local", "path": name}}}, 201)
                return None
            name = urllib.parse.unquote(path.removeprefix("/api/v1/files/local/").removeprefix("/api/files/local/"))
            if method == "PUT":
                if self.print:
                    return self.json(writer, {"title": "Busy"}, 409)
                if "print-after-upload" in request.headers:
                    self.note("print after upload")
                body = await request.body(reader, writer, self)
                if body is None:
                    return None
                self.note("upload", name=name, bytes=len(body))
                if self.take_file(name, body, writer) and not self.lost("upload", writer):
                    self.json(writer, {"name": name}, 201)
                return None
            if method == "GET":
                if name not in self.files:
                    return self.json(writer, {"title": "Not found"}, 404)
                return self.json(writer, {"name": name, "size": len(self.files[name]) - (1 if self.trap("short") else 0)})
            body = await request.body(reader, writer, self)
            if "/v1/" not in path and json.loads(body) != {"command": "select", "print": True}:
                return self.json(writer, {"title": "what?"}, 409)
            return self.start_file(name, writer)

        # --- NanoDLP

        async def nanodlp(self, request, reader, writer):
            path = request.path
            found = lambda: peer_http.answer(writer, 302, b"", headers=[("Location", "/dashboard")])
            if self.trap("password") and path != "/login" and "session=s1" not in request.headers.get("cookie", ""):
                return peer_http.answer(writer, 302, b"", headers=[("Location", "/login")])
            if path == "/login":
                body = await request.body(reader, writer, self)
                fields = urllib.parse.parse_qs(body.decode())
                if fields == {"username": ["maker"], "password": [KEY]}:
                    return peer_http.answer(writer, 302, b"", headers=[("Set-Cookie", "session=s1; Path=/"), ("Location", "/")])
                return peer_http.answer(writer, 200, b"<html>again</html>", "text/html")
            if self.stop_due and time.monotonic() >= self.stop_due and self.print:
                self.stop_due = None
                self.end("stopped")
            if path == "/status":
                p = self.print
                value = {"Printing": 1 if p else False, "Paused": bool(p and p["paused"]), "Halted": False, "Panicked": False,
                         "State": (4 if self.stop_due else 3 if p["paused"] else 2 if p["pause_due"] else 5) if p else 0,
                         "LayerID": self.layer() if p else 0, "LayersCount": p["layers"] if p else 0, "PlateID": 1,
                         "LayerTime": int(self.layer_s() * 1e9), "Path": p["name"] if p else "", "Hostname": "nano", "Build": "7",
                         "New": []}
                return self.json(writer, value)
            if path == "/json/db/profiles.json":
                return self.json(writer, [{"ProfileID": 7, "Title": "clear"}])
            if path == "/plates/list/json":
                now = time.monotonic()
                return self.json(writer, [{"PlateID": i, "Path": n, "LayersCount": 5 if now >= self.later.get(n, 0) else 0}
                                          for i, n in self.plates.items()])
            if path == "/plate/add":
                body = await request.body(reader, writer, self)
                if body is None:
                    return None
                fields = peer_http.form(request.headers["content-type"], body)
                name = fields["Path"][0].decode()
                self.note("upload", name=name, bytes=len(fields["ZipFile"][0]), profile=fields["ProfileID"][0].decode())
                if not self.trap("junk"):
                    number = len(self.plates) + 11
                    self.plates[number] = name
                    self.files[name] = fields["ZipFile"][0]
                    self.later[name] = time.monotonic() + self.value("list-s", 0.3)
                return None if self.lost("upload", writer) else found()
            started = re.fullmatch(r"/printer/start/(\d+)", path)
            if started:
                name = self.plates.get(int(started.group(1)))
                if name and not self.print and not self.trap("start-ignored"):
                    self.begin(name)
                return None if self.lost("start", writer) else found()
            if path == "/printer/resume":
                self.note("resume is not unpause")
                return found()
            if path in ("/printer/pause", "/printer/unpause", "/printer/stop") and self.print:
                if path.endswith("/pause"):
                    self.ask_pause()
                elif path.endswith("unpause"):
                    self.resume()
                else:
                    self.stop_due = time.monotonic() + self.layer_s()
                return found()
            return peer_http.answer(writer, 404, b"<html></html>", "text/html")

        # --- Odyssey

        def end(self, how):
            self.kept = dict(self.print)
            super().end(how)

        async def odyssey(self, request, reader, writer):
            path = request.path
            query = {k: v[0] for k, v in urllib.parse.parse_qs(request.query).items()}
            if self.trap("shutdown"):
                writer.transport.abort()
                return None
            if path == "/files" and request.method == "POST":
                body = await request.body(reader, writer, self)
                if body is None:
                    return None
                data, name = peer_http.form(request.headers["content-type"], body)["file"]
                self.note("upload", name=name, bytes=len(data), over=name in self.files)
                if not self.trap("junk"):
                    self.files[name] = data
                return None if self.lost("upload", writer) else peer_http.answer(writer, 200, b"")
            if path == "/file/thumbnail":
                good = query.get("location") == "Local" and query.get("size") == "Large"
                return peer_http.answer(writer, 200 if good else 404, picture() if good else b"", "image/png")
            if path == "/files":
                listed = [{"file_data": {"path": n, "name": n, "file_size": len(d), "location_category": "Local"}, "layer_count": 5}
                          for n, d in self.files.items() if n.endswith(".sl1")]
                at, size = int(query.get("page_index", 0)), int(query.get("page_size", 100))
                page = listed[at * size:(at + 1) * size]
                return self.json(writer, {"files": page, "dirs": [], "next_index": at + 1 if len(listed) > (at + 1) * size else None})
            if path == "/status":
                p = self.print
                data = p or self.kept
                value = {"print_data": {"file_data": {"name": data["name"], "path": data["name"]}, "layer_count": data["layers"],
                                        "print_time": data["layers"] * self.layer_s()} if data else None,
                         "paused": bool(p["paused"]) if p else None, "layer": None, "status": "Printing" if p else "Idle",
                         "physical_state": {"z": 1.5, "z_microns": 1500, "curing": False}}
                if p:
                    value["layer"] = self.layer()
                elif self.last and self.last[1] == "finished":
                    value["layer"] = self.last[3]
                return self.json(writer, value)
            if path == "/print/start":
                name = query["file_path"]
                # Dropped with 200 in a wrong state.
                if name in self.files and not self.print and not self.trap("start-ignored"):
                    self.begin(name)
                return None if self.lost("start", writer) else peer_http.answer(writer, 200, b"")
            if path in ("/print/pause", "/print/resume", "/print/cancel"):
                p = self.print
                if p and path.endswith("pause") and not p["paused"]:
                    self.ask_pause()
                elif p and path.endswith("resume") and p["paused"]:
                    self.resume()
                elif p and path.endswith("cancel"):
                    self.end("stopped")
                return peer_http.answer(writer, 200, b"")
            return peer_http.answer(writer, 404, b"")

    return Rest()
