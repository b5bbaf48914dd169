#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A slicer that sends a file to a printer that speaks SDCP 3, written from the description of the protocol alone. Usage:
machine_client.py HOST PORT UDP_PORT FILE NAME [--md5 WRONG] [--start]. Prints one line of JSON with all that it was told."""

import base64
import hashlib
import json
import os
import socket
import struct
import sys
import time

host, port, udp_port, path, name = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4], sys.argv[5]
options = sys.argv[6:]
PART = 1 << 20


def discover():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.settimeout(2)
        s.sendto(b"M99999", (host, udp_port))
        try:
            return json.loads(s.recv(8192))["Data"]
        except TimeoutError:
            return None


class Socket:
    def __init__(self):
        self.s = socket.create_connection((host, port), 5)
        key = base64.b64encode(os.urandom(16)).decode()
        self.s.sendall((f"GET /websocket HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n").encode())
        self.data = b""
        head = self.until(b"\r\n\r\n")
        accept = base64.b64encode(hashlib.sha1((key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()).digest())
        assert b"101" in head.split(b"\r\n")[0] and accept in head, head
        self.pushed = []

    def more(self):
        data = self.s.recv(65536)
        if not data:
            raise ConnectionError("closed")
        self.data += data

    def until(self, mark):
        while mark not in self.data:
            self.more()
        head, self.data = self.data.split(mark, 1)
        return head

    def take(self, n):
        while len(self.data) < n:
            self.more()
        piece, self.data = self.data[:n], self.data[n:]
        return piece

    def text(self, payload):
        data, mask = payload.encode(), os.urandom(4)
        size = bytes([0x80 | len(data)]) if len(data) < 126 else bytes([0x80 | 126]) + struct.pack(">H", len(data))
        self.s.sendall(b"\x81" + size + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)))

    def message(self):
        whole = b""
        while True:
            first, size = self.take(2)
            if size == 126:
                size, = struct.unpack(">H", self.take(2))
            elif size == 127:
                size, = struct.unpack(">Q", self.take(8))
            data = self.take(size)
            if first & 15 == 8:
                raise ConnectionError("closed")
            if first & 15 > 8:
                continue
            whole += data
            if first & 0x80:
                return whole.decode()

    def ask(self, cmd, data=None, push=None):
        """The answer's data, and the first push with this word in its topic."""
        request = os.urandom(8).hex()
        self.text(json.dumps({"Id": "s", "Data": {"Cmd": cmd, "Data": data or {}, "RequestID": request, "MainboardID": "",
                                                  "TimeStamp": int(time.time()), "From": 0}, "Topic": "sdcp/request/x"}))
        answer = pushed = None
        while answer is None or (push and pushed is None):
            message = json.loads(self.message())
            self.pushed.append(message)
            if "/response/" in message["Topic"] and message["Data"]["RequestID"] == request:
                answer = message["Data"]["Data"]
            elif push and push in message["Topic"]:
                pushed = message
        return (answer, pushed) if push else answer


def post(fields, file):
    boundary = "b" + os.urandom(8).hex()
    body = b""
    for key, value in fields:
        body += f'--{boundary}\r\nContent-Disposition: form-data; name="{key}"\r\n\r\n{value}\r\n'.encode()
    body += (f'--{boundary}\r\nContent-Disposition: form-data; name="File"; filename="{name}"\r\n'
             "Content-Type: application/octet-stream\r\n\r\n").encode() + file + f"\r\n--{boundary}--\r\n".encode()
    with socket.create_connection((host, port), 5) as s:
        s.sendall((f"POST /uploadFile/upload HTTP/1.1\r\nHost: {host}\r\nContent-Type: multipart/form-data; boundary={boundary}\r\n"
                   f"Content-Length: {len(body)}\r\n\r\n").encode() + body)
        answer = b""
        while piece := s.recv(65536):
            answer += piece
    return json.loads(answer.split(b"\r\n\r\n", 1)[1])


told = {"found": discover()}
if told["found"] is None:
    print(json.dumps(told))
    sys.exit(0)
s = Socket()
s.text("ping")
told["pong"] = s.message()
told["attributes"] = s.ask(1, push="attributes")[1]["Attributes"]
data = open(path, "rb").read()
md5 = hashlib.md5(data).hexdigest() if "--md5" not in options else "0" * 32
uuid = os.urandom(16).hex()
fields = lambda at: [("S-File-MD5", md5), ("Check", 1), ("Offset", at), ("Uuid", uuid), ("TotalSize", len(data))]
# A place that is not the next one.
told["wrong_place"] = post(fields(7), data[:10])
told["parts"] = [post(fields(at), data[at:at + PART]) for at in range(0, len(data), PART)]
told["states"] = []
for _ in range(400):
    current = s.ask(0, push="status")[1]["Status"]["CurrentStatus"]
    if not told["states"] or told["states"][-1] != current:
        told["states"].append(current)
    if 2 not in current:
        break
    time.sleep(0.05)
told["listed"] = [f["name"] for f in s.ask(258, {"Url": "/local"})["FileList"]]
told["start"] = s.ask(128, {"Filename": name, "StartLayer": 0})
told["errors"] = [m["Data"]["Data"]["ErrorCode"] for m in s.pushed if "/error/" in m["Topic"]]
print(json.dumps(told))
