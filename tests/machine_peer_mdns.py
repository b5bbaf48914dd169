# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""How machine_peer.py announces itself: mDNS (RFC 6762, 6763) on 127.0.0.1, written from the standards. Answers questions that
come from any port, as a responder must for those that speak no mDNS themselves (6.7): to the sender alone, with the question
repeated."""

import socket
import struct

GROUP = "224.0.0.251"
SERVICE = "_octoprint._tcp.local"


def labels(name):
    return b"".join(bytes([len(part)]) + part for part in name) + b"\0"


def split(name):
    return [part.encode() for part in name.split(".")]


def read_name(data, at):
    """The labels at a place, and the place behind them."""
    parts, end = [], None
    while data[at]:
        if data[at] >= 0xC0:
            end = end or at + 2
            at = struct.unpack_from(">H", data, at)[0] & 0x3FFF
            continue
        parts.append(data[at + 1:at + 1 + data[at]])
        at += 1 + data[at]
    return parts, end or at + 1


def record(name, kind, data, flush=True):
    return labels(name) + struct.pack(">HHIH", kind, 0x8001 if flush else 1, 10, len(data)) + data


def answer(question, machine, port, texts):
    number, flags, count = struct.unpack_from(">HHH", question)
    if flags & 0x8000:
        return None
    at, asked = 12, []
    for _ in range(count):
        name, at = read_name(question, at)
        kind, = struct.unpack_from(">H", question, at)
        at += 4
        asked.append((name, kind))
    repeated = question[12:at]
    service = split(SERVICE)
    instance = [machine.name.encode()] + service
    host = [b"printer", b"local"]
    ptr = record(service, 12, labels(instance), flush=False)
    srv = record(instance, 33, struct.pack(">HHH", 0, 0, port) + labels(host))
    txt = record(instance, 16, b"".join(bytes([len(t)]) + t for t in (x.encode() for x in texts)) or b"\0")
    # What the machine believes its address to be.
    address = record(host, 1, socket.inet_aton("10.9.8.7"))
    small = lambda name: [part.lower() for part in name]
    answers, more = [], []
    for name, kind in asked:
        if small(name) == small(service) and kind in (12, 255):
            answers.append(ptr)
            more += [] if machine.trap("bare") else [srv, txt, address]
        if small(name) == small(instance) and kind in (33, 255):
            answers.append(srv)
        if small(name) == small(instance) and kind in (16, 255):
            answers.append(txt)
    if not answers:
        return None
    data = struct.pack(">HHHHHH", number, 0x8400, count, len(answers), 0, len(more)) + repeated + b"".join(answers + more)
    if machine.trap("damaged"):
        data = data[:len(data) // 2]
    return data


def sockets():
    """One for questions to 127.0.0.1 alone, and one on the same port for those to everybody there."""
    alone = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    alone.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    alone.bind(("127.0.0.1", 0))
    all_ = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    all_.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    all_.bind((GROUP, alone.getsockname()[1]))
    all_.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + socket.inet_aton("127.0.0.1"))
    for each in (alone, all_):
        each.setblocking(False)
    return alone, all_
