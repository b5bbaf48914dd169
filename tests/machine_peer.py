#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A printer on the network to test against, written from the descriptions of its protocol alone; it shares no code with
what it tests, and is strict where machines are. Usage: machine_peer.py KIND [--trap NAME[=VALUE]]...

KIND is sdcp3, sdcp1, prusalink, prusalink-v1, octoprint, nanodlp or odyssey. Listens on 127.0.0.1 and prints one line of JSON
with its ports. Each line on stdin is a command: `log` prints all that happened as JSON; `trap NAME[=VALUE]` and
`untrap NAME` change what goes wrong; `finish` ends the print; `print NAME` begins one, as somebody at the machine; `power`
forgets the print and closes all connections. With the trap `announce` it answers mDNS, at the port `mdns`. It ends with its
stdin."""

import asyncio
import base64
import hashlib
import json
import os
import re
import struct
import sys
import time

import machine_peer_http as peer_http

PART = 1_048_576


class Machine:
    """What all kinds have: files, a print with a clock, traps, a log."""

    def __init__(self, traps):
        self.traps = traps
        self.log = []
        self.files = {}          # name -> bytes, whole and checked
        self.print = None        # {"name", "begun", "layers", "paused", "task"}
        self.last = None         # the print that ended: (name, how, layers, task)
        self.writers = set()
        self.begun = 0
        self.tasks = {}

    def note(self, what, **more):
        self.log.append({"what": what, **more})

    def trap(self, name):
        return name in self.traps

    def value(self, name, otherwise):
        return float(self.traps.get(name) or otherwise)

    def spring(self, name):
        """A trap that goes off a number of times (once unless said)."""
        if name not in self.traps:
            return False
        left = int(self.traps[name] or 1)
        if left <= 1:
            del self.traps[name]
        else:
            self.traps[name] = str(left - 1)
        return True

    def begin(self, name):
        self.begun += 1
        task = f"task-{self.begun}"
        self.print = {"name": name, "begun": time.monotonic(), "layers": int(self.value("layers", 1000)), "paused": None,
                      "task": task, "pause_due": None}
        self.note("begun", name=name, task=task)

    def layer_s(self):
        return self.value("layer-s", 0.02)

    def tick(self):
        """Moves the print on; layers end before a pause holds."""
        p = self.print
        if not p:
            return
        now = time.monotonic()
        if p["pause_due"] and now >= p["pause_due"]:
            p["paused"], p["pause_due"] = now, None
            self.note("paused")
        if p["paused"] is None and self.layer() >= p["layers"]:
            self.end("finished")

    def layer(self):
        p = self.print
        now = p["paused"] or time.monotonic()
        return min(int((now - p["begun"]) / self.layer_s()), p["layers"])

    def end(self, how):
        p = self.print
        self.last = (p["name"], how, self.layer(), p["layers"], p["task"])
        self.tasks[p["task"]] = how
        self.print = None
        self.note("ended", how=how)

    def ask_pause(self):
        self.print["pause_due"] = time.monotonic() + self.layer_s()

    def resume(self):
        p = self.print
        p["begun"] += time.monotonic() - p["paused"]
        p["paused"] = None
        self.note("resumed")

    def power(self):
        self.note("power")
        if self.print:
            self.end("power")
        self.last = None
        self.reboot()
        for writer in list(self.writers):
            writer.transport.abort()

    def reboot(self):
        pass


def busy_with(machine):
    return machine.checking or machine.receiving


class Sdcp3(Machine):
    ID = "000000000001d354"

    def __init__(self, traps):
        super().__init__(traps)
        self.uploads = {}
        self.checking = None     # (until the first phase ends, until the second, name, bytes or None)
        self.sockets = 0
        self.receiving = False

    def reboot(self):
        self.uploads, self.checking, self.receiving = {}, None, False

    # --- discovery

    def datagram(self, data):
        self.note("datagram", hex=data.hex())
        if data != b"M99999":
            return None
        fields = {"Name": "Größe", "MachineName": "Saturn X", "BrandName": "E", "MainboardIP": "10.9.8.7",
                  "MainboardID": self.ID, "ProtocolVersion": "V3.0.0", "FirmwareVersion": "V1.5.6"}
        if self.trap("v1-shape"):
            fields["ProtocolVersion"] = "V1.0.0"
            return json.dumps({"Id": "x", "Data": {"Attributes": fields, "Status": {}}}).encode()
        return json.dumps({"Id": "x", "Data": fields, "More": [1]}).encode()

    def datagram_from(self, data, address):
        return self.datagram(data)

    # --- status

    def now(self):
        self.tick()
        current, phase = [0], 0
        info = {"Status": 0, "CurrentLayer": 0, "TotalLayer": 0, "CurrentTicks": 0, "TotalTicks": 0, "Filename": "",
                "ErrorNumber": 0, "TaskId": ""}
        if self.checking:
            first, second, name, data = self.checking
            if time.monotonic() >= second:
                self.checking = None
                if data is not None:
                    self.files[name] = data
                    self.note("listed", name=name, bytes=len(data))
                else:
                    self.note("dropped", name=name)
            else:
                current = [2, 8] if time.monotonic() < first else [2]
        if self.receiving and not self.checking:
            current = [2]
        if self.print:
            p = self.print
            phase = 6 if p["paused"] else 5 if p["pause_due"] else 3
            if self.trap("unknown-phase") and phase == 3:
                phase = 99
            current = [1]
            ms = int(1000 * self.layer_s())
            info |= {"CurrentLayer": self.layer(), "TotalLayer": p["layers"], "CurrentTicks": self.layer() * ms,
                     "TotalTicks": p["layers"] * ms, "Filename": p["name"], "TaskId": p["task"]}
        elif self.last:
            # The old layers stay, without name of the task.
            name, how, layer, layers, _ = self.last
            info |= {"CurrentLayer": layer, "TotalLayer": layers, "CurrentTicks": 2757032, "TotalTicks": 2757032,
                     "Filename": name}
            if self.trap("phase-stays"):
                phase = {"finished": 9, "stopped": 8}.get(how, 0)
        info["Status"] = float(phase) if self.trap("floats") else phase
        if self.trap("floats"):
            info["CurrentLayer"] = float(info["CurrentLayer"])
            current = [float(c) for c in current]
        if self.trap("missing"):
            del info["ErrorNumber"]
            info["TotalTicks"] = "soon"
        status = {"CurrentStatus": current, "PrintInfo": info, "TempOfUVLED": 41.03, "New": {"x": [None]}}
        if self.trap("nested-status"):
            return {"Id": "b", "Data": {"Status": status, "MainboardID": self.ID}, "Topic": f"sdcp/status/{self.ID}"}
        return {"Status": status, "MainboardID": self.ID, "TimeStamp": int(time.time()), "Topic": f"sdcp/status/{self.ID}"}

    def attributes(self):
        return {"Attributes": {"MachineName": "Saturn X", "FirmwareVersion": "V1.5.6", "MainboardID": self.ID,
                               "Resolution": self.traps.get("resolution", "192x108"), "XYZsize": "218.88x128.88x220",
                               "SupportFileType": ["CTB", "GOO"], "Capabilities": ["FILE_TRANSFER", "PRINT_CONTROL"]},
                "MainboardID": self.ID, "Topic": f"sdcp/attributes/{self.ID}"}

    def command(self, cmd, data):
        """The members of the answer beside what all have."""
        self.tick()
        busy = self.checking or self.receiving
        if cmd in (0, 1):
            return {"Ack": 0}
        if cmd == 128:
            if set(data) != {"Filename", "StartLayer"}:
                return {"Ack": 6}
            name = data["Filename"].removeprefix("/local/")
            self.now()
            if self.spring("busy") or self.print or busy:
                self.note("busy")
                return {"Ack": 1}
            if name not in self.files:
                return {"Ack": 2}
            if "start-ack" in self.traps:
                return {"Ack": int(self.traps["start-ack"])}
            if self.trap("start-ignored"):
                return {"Ack": 0}
            self.begin(name)
            return {"Ack": 0}
        if cmd in (129, 130, 131):
            if not self.print:
                return {"Ack": 1}
            if cmd == 129:
                self.ask_pause()
            elif cmd == 130:
                self.end("stopped")
            elif self.print["paused"]:
                self.resume()
            return {"Ack": 0}
        if cmd == 258:
            self.now()
            return {"Ack": 0, "FileList": [{"name": f"/local/{n}", "type": 1} for n in self.files] + [{"name": "/local/d", "type": 0}]}
        if cmd == 259:
            for path in data.get("FileList", []):
                self.files.pop(path.removeprefix("/local/"), None)
            return {"Ack": 0}
        if cmd == 321:
            numbers = {"finished": 1, "stopped": 3, "power": 2}
            return {"Ack": 0, "HistoryDetailList": [
                {"TaskId": t, "TaskStatus": numbers.get(self.tasks[t], 0)} |
                ({"ErrorStatusReason": int(self.traps["reason"])} if "reason" in self.traps else {})
                for t in data.get("Id", []) if t in self.tasks]}
        return {"Ack": 0}

    # --- HTTP and WebSocket on one port

    async def serve(self, request, reader, writer):
        if request.path == "/websocket" and "upgrade" in request.headers.get("connection", "").lower():
            return await self.websocket(request, reader, writer)
        if request.path == "/uploadFile/upload" and request.method == "POST":
            return await self.part(request, reader, writer)
        return peer_http.answer(writer, 404, b"", "text/html")

    async def part(self, request, reader, writer):
        self.receiving = True
        try:
            body = await request.body(reader, writer, self)
        finally:
            self.receiving = False
        if body is None:
            return None
        fields = peer_http.form(request.headers.get("content-type", ""), body)
        offset, total = int(fields["Offset"][0]), int(fields["TotalSize"][0])
        name, data = fields["File"][1], fields["File"][0]
        md5, uuid = fields["S-File-MD5"][0].decode(), fields["Uuid"][0].decode()
        self.note("part", offset=offset, bytes=len(data), md5=md5, own_md5=hashlib.md5(data).hexdigest(), total=total, uuid=uuid,
                  check=fields["Check"][0].decode(), name=name, order=list(fields))
        if len(data) > PART:
            self.note("reset: too large")
            writer.transport.abort()
            return None
        if self.trap("html"):
            return peer_http.answer(writer, 200, b"<html>login</html>", "text/html")
        if self.spring("refuse-part"):
            return peer_http.answer(writer, 200, bad(-3))
        held = self.uploads.get(uuid, b"")
        if offset == 0 and not held:
            self.uploads = {uuid: b""}
        if offset != len(held):
            self.note("offset", wanted=len(held), got=offset)
            return peer_http.answer(writer, 200, bad(-2))
        held += data
        self.uploads[uuid] = held
        if len(held) >= total:
            known = name.rsplit(".", 1)[-1].lower() in ("ctb", "goo")
            whole = len(held) == total and hashlib.md5(held).hexdigest() == md5 and known
            if self.trap("junk"):
                whole = False
            check = self.value("check-s", 0.2)
            self.checking = (time.monotonic() + check / 2, time.monotonic() + check, name, held if whole else None)
            self.uploads = {}
        if self.spring("lose-part-answer"):
            self.note("answer lost")
            writer.transport.abort()
            return None
        return peer_http.answer(writer, 200, json.dumps({"code": "000000", "messages": None, "data": {}, "success": True}).encode())

    async def websocket(self, request, reader, writer):
        if self.sockets >= 5:
            return peer_http.answer(writer, 500, b"too many client", "text/plain")
        key = request.headers["sec-websocket-key"]
        accept = base64.b64encode(hashlib.sha1((key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()).digest()).decode()
        writer.write(("HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                      f"Sec-WebSocket-Accept: {accept}\r\n\r\n").encode())
        self.sockets += 1
        try:
            while True:
                text = await read_text(reader, writer)
                if text is None:
                    return None
                if text == "ping":
                    if not self.trap("ignore-ping"):
                        self.send(writer, "pong")
                    continue
                message = json.loads(text)
                await self.answer(message, writer)
        finally:
            self.sockets -= 1

    async def answer(self, message, writer):
        data = message["Data"]
        cmd = data["Cmd"]
        self.note("cmd", cmd=cmd, data=data["Data"], topic=message.get("Topic"), request=data["RequestID"])
        if self.spring(f"lose-cmd-{cmd}"):
            self.note("lost")
            writer.transport.abort()
            return
        more = self.command(cmd, data["Data"])
        if self.spring(f"lose-answer-{cmd}"):
            self.note("answer lost")
            writer.transport.abort()
            return
        response = {"Id": "brand", "Data": {"Cmd": cmd, "Data": more, "RequestID": data["RequestID"], "MainboardID": self.ID,
                                            "TimeStamp": int(time.time())}, "Topic": f"sdcp/response/{self.ID}"}
        # Pushes come between a request and its answer, and an answer to somebody else.
        self.push(writer, self.now())
        other = json.loads(json.dumps(response))
        other["Data"]["RequestID"] = "0" * 32
        self.send(writer, json.dumps(other))
        self.send(writer, json.dumps(response, ensure_ascii=False))
        if cmd == 0:
            if "error-push" in self.traps and not self.print and not busy_with(self):
                self.push(writer, {"Id": "b", "Data": {"Data": {"ErrorCode": self.traps["error-push"]}, "MainboardID": self.ID},
                                   "Topic": f"sdcp/error/{self.ID}"})
            self.push(writer, self.now())
        if cmd == 1:
            self.push(writer, self.attributes())

    def push(self, writer, message):
        if not self.trap("no-push"):
            self.send(writer, json.dumps(message, ensure_ascii=False))

    def send(self, writer, text):
        data = text.encode()
        pieces = [data]
        if self.trap("split") and len(data) > 3:
            pieces = [data[:1], data[1:len(data) // 2], data[len(data) // 2:]]
        for i, piece in enumerate(pieces):
            head = (0x01 if i == 0 else 0x00) | (0x80 if i + 1 == len(pieces) else 0)
            n = len(piece)
            size = bytes([n]) if n < 126 else b"\x7e" + struct.pack(">H", n) if n < 65536 else b"\x7f" + struct.pack(">Q", n)
            writer.write(bytes([head]) + size + piece)


def bad(number):
    return json.dumps({"code": "111111", "messages": [{"field": "common_field", "message": number}], "data": None,
                       "success": False}).encode()


async def read_text(reader, writer):
    text = b""
    while True:
        try:
            first, second = await reader.readexactly(2)
            size = second & 0x7F
            if size == 126:
                size, = struct.unpack(">H", await reader.readexactly(2))
            elif size == 127:
                size, = struct.unpack(">Q", await reader.readexactly(8))
            if not second & 0x80:
                return None                   # clients mask
            mask = await reader.readexactly(4)
            data = bytes(b ^ mask[i % 4] for i, b in enumerate(await reader.readexactly(size)))
        except (asyncio.IncompleteReadError, ConnectionError):
            return None
        kind = first & 0x0F
        if kind == 8:
            return None
        if kind == 9:
            writer.write(bytes([0x8A, len(data)]) + data)
            continue
        text += data
        if first & 0x80:
            return text.decode()


class Datagrams(asyncio.DatagramProtocol):
    def __init__(self, machine):
        self.machine = machine

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, address):
        answer = self.machine.datagram_from(data, address)
        if answer:
            self.transport.sendto(answer, address)


def traps_of(arguments):
    traps = {}
    for i, word in enumerate(arguments):
        if word == "--trap":
            name, _, value = arguments[i + 1].partition("=")
            traps[name] = value
    return traps


async def main():
    kind = sys.argv[1]
    traps = traps_of(sys.argv[2:])
    if kind == "sdcp3":
        machine = Sdcp3(traps)
    elif kind == "sdcp1":
        import machine_peer_mqtt
        machine = machine_peer_mqtt.make(Sdcp3, traps)
    else:
        import machine_peer_rest
        machine = machine_peer_rest.make(kind, Machine, traps)
    server = await asyncio.start_server(lambda r, w: peer_http.connection(machine, r, w), "127.0.0.1", 0)
    ports = {"port": server.sockets[0].getsockname()[1]}
    if kind in ("sdcp3", "sdcp1"):
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: Datagrams(machine), local_addr=("127.0.0.1", 0))
        ports["udp"] = transport.get_extra_info("sockname")[1]
    if machine.trap("announce"):
        import machine_peer_mdns as mdns
        machine.name = f"Größe. {os.getpid()}"
        texts = ["path=/", "Model=SL1S", "vendor=Prusa Research", "version=1.8"] if kind.startswith("prusalink") else ["path=/"]
        alone, all_ = mdns.sockets()

        def asked(one):
            data, sender = one.recvfrom(9000)
            machine.note("mdns", hex=data.hex(), everybody=one is all_)
            try:
                told = mdns.answer(data, machine, ports["port"], texts)
            except (IndexError, struct.error):
                return
            if told:
                alone.sendto(told, sender)

        for each in (alone, all_):
            asyncio.get_running_loop().add_reader(each, asked, each)
        ports["mdns"] = alone.getsockname()[1]
    print(json.dumps(ports), flush=True)
    stdin = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdin), sys.stdin)
    while line := (await stdin.readline()).decode().split():
        word, rest = line[0], line[1:]
        if word == "log":
            print(json.dumps({"log": machine.log, "begun": machine.begun,
                              "files": {n: hashlib.sha256(d).hexdigest() for n, d in machine.files.items()},
                              "printing": bool(machine.print)}), flush=True)
            continue
        if word == "trap":
            machine.traps |= traps_of(["--trap", rest[0]])
        elif word == "untrap":
            machine.traps.pop(rest[0], None)
        elif word == "finish" and machine.print:
            machine.end("finished")
        elif word == "print":
            machine.begin(rest[0])
        elif word == "power":
            machine.power()
        print(json.dumps({"done": word}), flush=True)
    os._exit(0)


if __name__ == "__main__":
    asyncio.run(main())
