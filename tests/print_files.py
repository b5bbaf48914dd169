# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""A second reader of CTB, GOO, Photon Workshop, Anycubic's zip and CXDLP 4, which shares nothing with the library.

Prints as JSON what a file says and a CRC-32 of the pixels of each layer: python3 print_files.py FILE [LAYER...]
"""
import io
import json
import struct
import sys
import zipfile
import zlib


class Wrong(Exception):
    pass


def need(condition, what):
    if not condition:
        raise Wrong(what)


def unpack(order, kinds, data, at):
    return struct.unpack_from(order + kinds, data, at)


def image(runs, count):
    parts, total = [], 0
    for value, length in runs:
        parts.append(bytes([value]) * length)
        total += length
    need(total == count, f"{total} pixels, expected {count}")
    return b"".join(parts)


# ---- CTB

def ctb_plain(data, key, layer):
    if key == 0:
        return data
    mask = 0xFFFFFFFF
    step = (key * 0x2D83CDAC + 0xD8A83423) & mask
    x = ((layer * 0x1E1530CD + 0xEC3D47CD) * step) & mask
    stream = bytearray()
    while len(stream) < len(data):
        stream += struct.pack("<I", x)
        x = (x + step) & mask
    length = len(data)
    both = int.from_bytes(data, "little") ^ int.from_bytes(stream[:length], "little")
    return both.to_bytes(length, "little")


def ctb_runs(data):
    at = 0
    while at < len(data):
        head = data[at]
        at += 1
        value, length = head & 0x7F, 1
        if head & 0x80:
            first = data[at]
            if first < 0x80:
                more, length = 0, first
            elif first < 0xC0:
                more, length = 1, first & 0x3F
            elif first < 0xE0:
                more, length = 2, first & 0x1F
            else:
                need(first < 0xF0, "length byte")
                more, length = 3, first & 0x0F
            for extra in data[at + 1:at + 1 + more]:
                length = length * 256 + extra
            at += 1 + more
        yield (0 if value == 0 else 2 * value + 1), length


def by_head(times, heeded, exposure, bottom, bottom_layers, fade):
    """The times that count: where printers do not heed those of single layers, what the head says."""
    if heeded:
        return times
    counts = []
    for n in range(len(times)):
        k = n - bottom_layers + 1
        if k <= 0:
            counts.append(bottom)
        elif bottom_layers > 0 and k <= fade:
            counts.append(bottom + (exposure - bottom) * k / (fade + 1))
        else:
            counts.append(exposure)
    return [round(t, 4) for t in counts]


def read_ctb(data, wanted):
    magic, version = unpack("<", "II", data, 0)
    need(magic in (0x12FD0086, 0x12FD0106), "magic")
    bed = unpack("<", "3f", data, 8)
    total, layer_mm, exposure, bottom = unpack("<", "4f", data, 0x1C)
    bottom_layers, width, height = unpack("<", "3I", data, 0x30)
    table, count = unpack("<", "II", data, 0x40)
    print_time, = unpack("<", "I", data, 0x4C)
    key, = unpack("<", "I", data, 0x64)
    slicer, = unpack("<", "I", data, 0x68)
    if version >= 4:
        v4, = unpack("<", "I", data, slicer + 0x40)
        last, = unpack("<", "I", data, v4 + 0x34)
        need(last == count - 1, "last layer's index")
    if version >= 5:
        resin, = unpack("<", "I", data, v4 + 0x50)
        for where, length in ((0x10, 0x0C), (0x18, 0x14), (0x08, 0x1C)):
            place, size = unpack("<", "I", data, resin + where)[0], unpack("<", "I", data, resin + length)[0]
            need(data[place:place + size].isalpha(), "text of the resin's block")
    layers, times, heights = {}, [], []
    for n in range(count):
        at = table + 0x24 * n
        z, time, _, offset, size, page, head = unpack("<", "fffIIII", data, at)
        offset += page << 32
        need(offset + size <= len(data), "layer beyond the end")
        times.append(round(time, 4))
        heights.append(round(z, 4))
        if version >= 3:
            need(head == 0x54, "head")
            need(data[offset - 0x54:offset - 0x54 + 0x24] == data[at:at + 0x24], "copy of the record")
            need(unpack("<", "I", data, offset - 0x30)[0] == 0x54 + size, "whole size")
        if wanted is None or n in wanted:
            plain = ctb_plain(data[offset:offset + size], key, n)
            layers[n] = zlib.crc32(image(ctb_runs(plain), width * height))
    need(abs(total - layer_mm * count) < layer_mm, "total height")
    return {"format": "ctb", "version": version, "size": [width, height], "count": count,
            "bed": [round(v, 4) for v in bed[:2]], "exposure_s": round(exposure, 4),
            "bottom_s": round(bottom, 4), "bottom_layers": bottom_layers,
            "times": by_head(times, data[slicer + 0x27] != 0, exposure, bottom, bottom_layers,
                             unpack("<", "I", data, slicer + 0x3C)[0] if version >= 4 else 0),
            "heights": heights, "print_time_s": print_time, "layers": layers}


# ---- GOO

def goo_runs(data):
    at, value = 0, 0
    while at < len(data):
        head = data[at]
        at += 1
        kind, more = head >> 6, head >> 4 & 3
        if kind == 2:
            length = 1
            value = (value - (head & 15) if head & 0x20 else value + (head & 15)) & 255
            if head & 0x10:
                length = data[at]
                at += 1
        else:
            if kind == 1:
                value = data[at]
                at += 1
            else:
                value = 0 if kind == 0 else 255
            length = int.from_bytes(data[at:at + more], "big") * 16 + (head & 15)
            at += more
        yield value, length


def read_goo(data, wanted):
    need(data[:12] == b"V3.0\x07\x00\x00\x00DLP\x00", "magic")
    count, width, height, mirror_x, mirror_y = unpack(">", "IHHBB", data, 0x2FAEE)
    bed_x, bed_y, _, layer_mm, exposure = unpack(">", "5f", data, 0x2FAF8)
    bottom, bottom_layers = unpack(">", "fI", data, 0x2FB29)
    print_time, = unpack(">", "I", data, 0x2FB76)
    at, = unpack(">", "I", data, 0x2FB8E)
    need(data[0x2FB92] == 1, "256 levels")
    layers, times, heights = {}, [], []
    for n in range(count):
        z, time = unpack(">", "ff", data, at + 6)
        need(data[at + 0x40:at + 0x42] == b"\r\n", "break before a layer")
        size, = unpack(">", "I", data, at + 0x42)
        code = data[at + 0x46:at + 0x46 + size]
        need(len(code) == size and code[0] == 0x55, "start of a layer")
        need((sum(code[1:-1]) & 255) ^ 255 == code[-1], "check byte")
        at += 0x46 + size
        need(data[at:at + 2] == b"\r\n", "break behind a layer")
        at += 2
        times.append(round(time, 4))
        heights.append(round(z, 4))
        if wanted is None or n in wanted:
            layers[n] = zlib.crc32(image(goo_runs(code[1:-1]), width * height))
    need(data[at:] == b"\x00\x00\x00\x07\x00\x00\x00DLP\x00", "end")
    return {"format": "goo", "size": [width, height], "count": count, "mirror": [mirror_x, mirror_y],
            "bed": [round(bed_x, 4), round(bed_y, 4)], "exposure_s": round(exposure, 4),
            "bottom_s": round(bottom, 4), "bottom_layers": bottom_layers,
            "times": by_head(times, data[0x2FB75] != 0, exposure, bottom, bottom_layers,
                             unpack(">", "H", data, 0x2FB93)[0]),
            "heights": heights, "print_time_s": print_time, "layers": layers}


# ---- Photon Workshop

def pw0_runs(data):
    at = 0
    while at < len(data):
        value, length = data[at] >> 4, data[at] & 15
        at += 1
        if value in (0, 15):
            length = length * 256 + data[at]
            at += 1
        yield 17 * value, length


def read_workshop(data, wanted):
    need(data[:12] == b"ANYCUBIC\0\0\0\0", "magic")
    version, _, header, _, _, _, table = unpack("<", "7I", data, 12)
    images, = unpack("<", "I", data, 0x30 if version >= 516 else 0x2C)
    need(data[header:header + 7] == b"HEADER\0", "HEADER")
    header += 16
    pixel_um, _, exposure, _, bottom, bottom_layers = unpack("<", "6f", data, header)
    aa, width, height = unpack("<", "III", data, header + 0x28)
    need(data[table:table + 9] == b"LAYERDEF\0", "LAYERDEF")
    length, count = unpack("<", "II", data, table + 12)
    need(length == 4 + 32 * count, "length of LAYERDEF")
    second = 0
    if version >= 517:
        need(data[unpack("<", "I", data, 0x34)[0]:][:6] == b"MODEL\0", "MODEL")
    if version >= 518:
        second, preview = unpack("<", "II", data, 0x38)
        need(data[preview:preview + 9] == b"PREVIEW2\0", "PREVIEW2")
        need(data[second:second + 8] == b"SUBIMGS\0", "SUBIMGS")
        need(unpack("<", "II", data, second + 12) == (24 + 44 * count, count), "size of SUBIMGS")
    layers, times, heights, z, first = {}, [], [], 0, None
    for n in range(count):
        offset, size, _, _, time, thick, lit, _ = unpack("<", "IIffffII", data, table + 20 + 32 * n)
        first = offset if first is None else min(first, offset)
        if second:
            need(unpack("<", "III", data, second + 24 + 44 * n) == (offset, size, lit), "the second list")
        z += thick
        times.append(round(time, 4))
        heights.append(round(z, 3))
        if wanted is None or n in wanted:
            pixels = image(pw0_runs(data[offset:offset + size]), width * height)
            need(lit == len(pixels) - pixels.count(0), "lit pixels")
            layers[n] = zlib.crc32(pixels)
    need(images == first, "offset of the images")
    return {"format": "photon-workshop", "version": version, "size": [width, height], "count": count,
            "aa": aa, "exposure_s": round(exposure, 4), "bottom_s": round(bottom, 4),
            "bottom_layers": round(bottom_layers),
            "times": by_head(times, unpack("<", "I", data, header + 0x40)[0] != 0, exposure, bottom,
                             round(bottom_layers),
                             unpack("<", "I", data, header + 0x48)[0] if version >= 516 else 0),
            "heights": heights, "layers": layers}


# ---- Anycubic's zip

def read_anycubic_zip(data, wanted):
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
        need(len(entries) == len(archive.namelist()), "doubled names")
    settings = json.loads(entries["anycubic_photon_resins.pwsp"])
    machine, more = settings["machine_type"], settings["machine_extern"]
    resin, = [r for r in more["user_resins"] if r["property"]["name"] == more["active_resins"][0]]
    basic = resin["slicepara"]
    width, height = machine["res_x"], machine["res_y"]
    paras = json.loads(entries["layers_controller.conf"])
    count = paras["count"]
    need(len(paras["paras"]) == count, "number of layers")
    need(sum(name.endswith(".pw0Img") for name in entries) == count, "number of images")
    info = json.loads(entries["print_info.json"])
    for said in [info] + info["sub_estimated_infos"]:
        need(said["model_layers_count"] == count, "number of layers in print_info.json")
    scene = entries["scene.slice"]
    need(unpack("<", "I", scene, 100)[0] == count == unpack("<", "I", scene, 392)[0], "layers of the scene")
    need(len(scene) == 396 + 64 * count + 4 and scene[-4:] == b"--->", "length of the scene")
    layers, times, heights, z = {}, [], [], 0
    for n, layer in enumerate(paras["paras"]):
        need(layer["layer_index"] == n, "index of a layer")
        need(abs(layer["layer_minheight"] - z) < 1e-4, "place of a layer")
        z += layer["layer_thickness"]
        need(abs(unpack("<", "f", scene, 396 + 64 * n)[0] - z) < 1e-4, "place of a layer in the scene")
        times.append(round(layer["exposure_time"], 4))
        heights.append(round(z, 3))
        if wanted is None or n in wanted:
            layers[n] = zlib.crc32(image(pw0_runs(entries[f"layer_images/layer_{n}.pw0Img"]), width * height))
    need(abs(unpack("<", "f", scene, 124)[0] - z) < 1e-4, "top of the scene")
    return {"format": "anycubic-zip", "size": [width, height], "count": count,
            "bed": [machine["print_xsize"], machine["print_ysize"]],
            "exposure_s": basic["exposure_time"], "bottom_s": basic["bott_time"],
            "bottom_layers": basic["bott_layers"],
            "times": by_head(times, basic["use_indivi_layerpara"] != 0, basic["exposure_time"],
                             basic["bott_time"], basic["bott_layers"],
                             resin["slice_extpara"]["transition_layercount"]),
            "heights": heights, "print_time_s": info["print_time"], "layers": layers}


# ---- CXDLP 4

def read_cxdlp4(data, wanted):
    need(data[:15] == b"\0\0\0\x09CXSW3DV2\0\0\x04", "magic")
    # A CRC-32 that starts with 0 and is not inverted at its end.
    need(unpack(">", "I", data, len(data) - 4)[0] == zlib.crc32(data[:-4], 0xFFFFFFFF) ^ 0xFFFFFFFF, "checksum")
    head = 19 + unpack(">", "I", data, 15)[0]
    (width, height, *bed, total, layer_mm, bottom_layers, _, table, count, _, print_time, projector,
     settings, _, _, light, _, key, slicer, _) = unpack("<", "HH5f9IIHHIII", data, head)
    need(unpack("<", "I", data, settings + 0x28)[0] == bottom_layers, "bottom layers")
    exposure, bottom = unpack("<", "ff", data, settings + 0x2C)
    need(unpack("<", "ff", data, slicer + 0x34) == (exposure, bottom), "exposures of the slicer")
    layers, times, heights = {}, [], []
    for n in range(count):
        z, time, _, offset, size, kind = unpack("<", "fffIII", data, table + 0x28 * n)
        need(kind == 0 and offset + size <= len(data) - 4, "a layer's record")
        need(unpack("<", "f", data, offset + 0x28)[0] == light, "a layer's light")
        times.append(round(time, 4))
        heights.append(round(z, 4))
        if wanted is None or n in wanted:
            plain = ctb_plain(data[offset + 44:offset + size], key, n)
            layers[n] = zlib.crc32(image(ctb_runs(plain), width * height))
    need(abs(total - layer_mm * count) < 1e-4, "total height")
    return {"format": "cxdlp", "version": 4, "size": [width, height], "count": count,
            "bed": [round(v, 4) for v in bed[:2]], "exposure_s": round(exposure, 4),
            "bottom_s": round(bottom, 4), "bottom_layers": bottom_layers, "mirror": [projector, 0],
            "times": by_head(times, unpack("<", "I", data, slicer + 0x1C)[0] != 0, exposure, bottom,
                             bottom_layers, unpack("<", "I", data, slicer + 0x40)[0]),
            "heights": heights, "print_time_s": print_time, "layers": layers}


def read(data, wanted):
    if data[:4] == b"PK\3\4":
        return read_anycubic_zip(data, wanted)
    if data[4:12] == b"CXSW3DV2":
        return read_cxdlp4(data, wanted)
    if data[:4] == b"V3.0":
        return read_goo(data, wanted)
    if data[:8] == b"ANYCUBIC":
        return read_workshop(data, wanted)
    return read_ctb(data, wanted)


if __name__ == "__main__":
    with open(sys.argv[1], "rb") as file:
        contents = file.read()
    try:
        print(json.dumps(read(contents, {int(n) for n in sys.argv[2:]} or None)))
    except (Wrong, struct.error, IndexError) as error:
        print(f"{sys.argv[1]}: {error!r}", file=sys.stderr)
        sys.exit(1)
