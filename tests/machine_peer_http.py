# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""HTTP/1.1 for machine_peer.py: one request per connection, bodies by their length, and what breaks connections."""

import asyncio
import re


class Request:
    def __init__(self, method, target, headers):
        self.method, self.target, self.headers = method, target, headers
        self.path, _, self.query = target.partition("?")

    async def body(self, reader, writer, machine):
        """The whole body, or None where the connection broke. Traps break it: `reset-at=N` after N bytes of it, once;
        `stall` after the first bytes; `slow` takes 1 kB/s."""
        size = int(self.headers.get("content-length", "0"))
        if self.headers.get("expect", "").lower() == "100-continue":
            writer.write(b"HTTP/1.1 100 Continue\r\n\r\n")
        data = b""
        reset = int(machine.traps["reset-at"]) if "reset-at" in machine.traps else None
        while len(data) < size:
            if machine.trap("stall") and data:
                await asyncio.sleep(3600)
            piece = await reader.read(min(65536, size - len(data)))
            if not piece:
                machine.note("cut off", bytes=len(data), of=size)
                return None
            data += piece
            if reset is not None and len(data) > reset:
                machine.traps.pop("reset-at", None)
                machine.note("reset", bytes=len(data), of=size)
                writer.transport.abort()
                return None
            if machine.trap("slow"):
                await asyncio.sleep(len(piece) / 1000)
        return data


async def connection(machine, reader, writer):
    machine.writers.add(writer)
    try:
        head = await reader.readuntil(b"\r\n\r\n")
        lines = head.decode("latin-1").split("\r\n")
        method, target, _ = lines[0].split(" ", 2)
        headers = {}
        for line in lines[1:]:
            if ":" in line:
                name, value = line.split(":", 1)
                headers[name.strip().lower()] = value.strip()
        await machine.serve(Request(method, target, headers), reader, writer)
        await writer.drain()
        writer.close()
    except (asyncio.IncompleteReadError, ConnectionError, asyncio.LimitOverrunError):
        pass
    finally:
        machine.writers.discard(writer)
        writer.close()


def answer(writer, status, body, kind="application/json", headers=()):
    reason = {200: "OK", 201: "Created", 204: "No Content", 302: "Found", 401: "Unauthorized", 403: "Forbidden", 404: "Not Found",
              409: "Conflict", 413: "Too Large", 415: "Unsupported", 500: "Error", 501: "Not Implemented"}[status]
    lines = [f"HTTP/1.1 {status} {reason}", f"Content-Length: {len(body)}", "Connection: close"]
    if body:
        lines.append(f"Content-Type: {kind}")
    lines += [f"{name}: {value}" for name, value in headers]
    writer.write("\r\n".join(lines).encode() + b"\r\n\r\n" + body)


def form(content_type, body):
    """Fields of multipart/form-data in their order: name -> (bytes, name of the file or None)."""
    boundary = re.search(r'boundary="?([^";]+)', content_type).group(1).encode()
    fields = {}
    for piece in body.split(b"--" + boundary)[1:-1]:
        head, data = piece.removeprefix(b"\r\n").split(b"\r\n\r\n", 1)
        text = head.decode()
        name = re.search(r'name="([^"]*)"', text).group(1)
        file = re.search(r'filename="([^"]*)"', text)
        fields[name] = (data.removesuffix(b"\r\n"), file.group(1) if file else None)
    return fields
