"""Reads a .wct file with numpy alone, as an example and as a check on the format.

    read_wct.py FILE PATCH < points

It reads raw sections. A coded tree (`region-haar`) needs the models of its arithmetic
coder, bit for bit, which are some 600 lines of crates/wrt-core/src/tree/codec: `tracer
convert FILE --raw -o OTHER` makes of it a file to be read here.

Each input line is "u v kappa lambda"; each output line the radiance there, "r g b".
"""

import json
import struct
import sys
import zlib

import numpy as np

DTYPES = {"u16": "<u2", "f32": "<f4"}


def read(path, sections=True):
    """The patches by name, each with its sections as arrays if asked for."""
    with open(path, "rb") as file:
        raw = file.read()
    magic, major, _, _, size, file_size, crc = struct.unpack_from("<8sHHIQQI", raw)
    assert magic == b"\x89WCT\r\n\x1a\n" and major == 1 and file_size == len(raw)
    data = 64 + size
    assert zlib.crc32(raw[64:data]) == crc
    patches = {}
    for patch in json.loads(raw[64:data])["patches"]:
        for name, s in patch["sections"].items() if sections else ():
            if s["codec"] != "raw":
                sys.exit(f"{path}: {s['codec']} code; tracer convert --raw makes a file to be read here")
            at = data + s["offset"]
            array = np.frombuffer(raw[at : at + s["nbytes"]], DTYPES[s["dtype"]])
            patch[name] = array.reshape(s["shape"])
        patches[patch["name"]] = patch
    return patches


def ones(x):
    return bin(x).count("1")


def radiance(patch, q):
    """The sum of coefficients along the path from the root to q."""
    value, depth = np.array(patch["root"], float), 0
    first_child = 1 + np.cumsum([0] + [ones(int(m)) for m in patch["child_mask"]])
    first_b = np.cumsum([0] + [ones(int(m)) for m in patch["nu_mask"]])
    levels = [patch["levels"][d] for d in ("position", "position", "direction", "direction")]
    node = 0 if patch["nodes"] else None
    while node is not None:
        split = [d for d in range(4) if depth < levels[d]]
        half = sum((int(q[d] * 2 ** (depth + 1)) & 1) << d for d in split)
        nu_mask, at = int(patch["nu_mask"][node]), first_b[node]
        for nu in (nu for nu in range(1, 16) if nu_mask >> nu & 1):
            # The functions of a node are +-scale on its cell.
            scale = 2.0 ** sum(min(depth, level) for level in levels[::2])
            value = value + (-1) ** ones(nu & half) * scale * patch["coefficients"][at]
            at += 1
        child_mask = int(patch["child_mask"][node])
        before = ones(child_mask & ((1 << half) - 1))
        node = int(first_child[node]) + before if child_mask >> half & 1 else None
        depth += 1
    return value


if __name__ == "__main__":
    patch = read(sys.argv[1])[sys.argv[2]]
    for line in sys.stdin:
        print(*map(repr, map(float, radiance(patch, [float(x) for x in line.split()]))))
