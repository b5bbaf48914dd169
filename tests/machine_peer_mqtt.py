# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A board with SDCP 1, for machine_peer.py: told by a datagram, it connects to whoever sent it as a client of MQTT 3.1.1, and
fetches files over HTTP from there."""

import asyncio
import hashlib
import json
import struct
import time
import urllib.parse


def text(value):
    data = value.encode()
    return struct.pack(">H", len(data)) + data


def packet(head, body):
    size, n = b"", len(body)
    while True:
        size += bytes([n % 128 | (128 if n > 127 else 0)])
        n //= 128
        if not n:
            return bytes([head]) + size + body


def make(sdcp3_class, traps):
    class Sdcp1(sdcp3_class):
        def __init__(self):
            super().__init__(traps)
            self.transfer = {"Status": 0, "DownloadOffset": 0, "CheckOffset": 0, "FileTotalSize": 0, "Filename": ""}
            self.transferring = False
            self.traps["v1-shape"] = ""
            self.broker = None
            self.link = None

        def datagram_from(self, data, address):
            if data.startswith(b"M66666 "):
                self.note("called", text=data.decode())
                if not self.spring("ignore-call"):
                    self.broker = (address[0], int(data.split()[1]))
                    asyncio.ensure_future(self.connect())
                return None
            return self.datagram(data)

        def status(self):
            self.tick()
            info = {"Status": 0, "CurrentLayer": 0, "TotalLayer": 0, "CurrentTicks": 0, "TotalTicks": 0, "Filename": "", "ErrorNumber": 0}
            current = 2 if self.transferring else 0
            if self.print:
                p, ms = self.print, int(1000 * self.layer_s())
                current = 1
                info |= {"Status": 6 if p["paused"] else 5 if p["pause_due"] else 3, "CurrentLayer": self.layer(),
                         "TotalLayer": p["layers"], "CurrentTicks": self.layer() * ms, "TotalTicks": p["layers"] * ms,
                         "Filename": p["name"]}
            elif self.last and self.last[1] == "finished":
                info |= {"Status": 16, "CurrentLayer": self.last[3], "TotalLayer": self.last[3], "Filename": self.last[0]}
            return {"CurrentStatus": current, "PrintInfo": info, "FileTransferInfo": self.transfer, "New": None}

        def publish(self, kind, data, quality=0):
            body = text(f"/sdcp/{kind}/{self.ID}")
            if quality:
                body += struct.pack(">H", 77)
            message = {"Id": "x", "Data": data | {"MainboardID": self.ID, "TimeStamp": int(time.time() * 1000)}}
            self.link.write(packet(0x30 | quality << 1, body + json.dumps(message, ensure_ascii=False).encode()))

        async def connect(self):
            try:
                reader, writer = await asyncio.open_connection(*self.broker)
            except OSError:
                self.note("no broker")
                return
            self.link = writer
            self.writers.add(writer)
            writer.write(packet(0x10, text("MQTT") + b"\x04\x02" + struct.pack(">H", 60) + text(self.ID)))
            try:
                while True:
                    head = (await reader.readexactly(1))[0]
                    size = shift = 0
                    while True:
                        byte = (await reader.readexactly(1))[0]
                        size |= (byte & 127) << shift
                        shift += 7
                        if byte < 128:
                            break
                    await self.came(head, await reader.readexactly(size), writer)
            except (asyncio.IncompleteReadError, ConnectionError):
                self.note("link ended")
            finally:
                self.writers.discard(writer)
                writer.close()

        async def came(self, head, body, writer):
            kind = head >> 4
            if kind == 2:
                self.note("connack", hex=(bytes([head, len(body)]) + body).hex())
                writer.write(packet(0x82, b"\x00\x05" + text(f"/sdcp/request/{self.ID}") + b"\x01"))
                writer.write(packet(0xC0, b""))
                return
            if kind in (9, 13, 4):
                self.note({9: "suback", 13: "pingresp", 4: "puback"}[kind], hex=(bytes([head, len(body)]) + body).hex())
                return
            size = struct.unpack(">H", body[:2])[0]
            topic, payload = body[2:2 + size].decode(), body[2 + size:]
            message = json.loads(payload)
            data = message["Data"]
            cmd = data["Cmd"]
            self.note("cmd", cmd=cmd, data=data["Data"], topic=topic, has_topic="Topic" in message, ms=data["TimeStamp"])
            if cmd == 256:
                asyncio.ensure_future(self.fetch(data["Data"]))
                more = {"Ack": 0}
            else:
                more = self.command(cmd, data["Data"])
            if self.spring(f"lose-answer-{cmd}"):
                writer.transport.abort()
                return
            if cmd == 64:
                writer.transport.abort()
                return
            self.publish("status", {"Status": self.status()}, 1)
            self.publish("response", {"Cmd": cmd, "Data": more, "RequestID": data["RequestID"]}, 1)
            if cmd == 0:
                self.publish("status", {"Status": self.status()})
            if cmd == 1:
                self.publish("attributes", {"Attributes": self.attributes()["Attributes"]})

        async def fetch(self, order):
            self.transferring = True
            name = order["Filename"]
            self.transfer = {"Status": 1, "DownloadOffset": 0, "CheckOffset": 0, "FileTotalSize": order["FileSize"], "Filename": name}
            url = urllib.parse.urlsplit(order["URL"].replace("${ipaddr}", self.broker[0]))
            self.note("order", url=order["URL"], size=order["FileSize"], md5=order["MD5"], keys=sorted(order))
            data = b""
            try:
                for method in ("HEAD", "GET"):
                    reader, writer = await asyncio.open_connection(url.hostname, url.port)
                    writer.write(f"{method} {url.path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode())
                    answer = await reader.read()
                    writer.close()
                    head, _, data = answer.partition(b"\r\n\r\n")
                    self.note("fetched", method=method, status=int(head.split()[1]), length=b"content-length" in head.lower(),
                              bytes=len(data))
                if self.spring("short"):
                    data = data[:len(data) // 2]
            except OSError:
                pass
            whole = hashlib.md5(data).hexdigest() == order["MD5"] and not self.trap("junk")
            if whole:
                self.files[name] = data
            self.transfer = self.transfer | {"Status": 2 if whole else 3, "DownloadOffset": len(data), "CheckOffset": len(data)}
            self.transferring = False

    return Sdcp1()
