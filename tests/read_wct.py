"""Reads a .wct file with numpy alone, as an example and as a check on the format.

    read_wct.py FILE PATCH < points

It reads raw sections, of boxes and of smooth patches, which are always raw. A coded tree
(`region-haar`) needs the models of its arithmetic coder, bit for bit, which are some 600
lines of crates/wrt-core/src/tree/codec: `tracer convert FILE --raw -o OTHER` makes of it a
file to be read here.

Each input line is "u v kappa lambda"; each output line the radiance there, "r g b".
"""

import json
import struct
import sys
import zlib

import numpy as np

DTYPES = {"u8": "u1", "u16": "<u2", "f32": "<f4"}


def read(path, sections=True):
    """The patches by name, each with its sections as arrays if asked for."""
    with open(path, "rb") as file:
        raw = file.read()
    magic, major, _, _, size, file_size, crc = struct.unpack_from("<8sHHIQQI", raw)
    assert magic == b"\x89WCT\r\n\x1a\n" and major == 1 and file_size == len(raw)
    data = 64 + size
    assert zlib.crc32(raw[64:data]) == crc
    patches = {}
    description = json.loads(raw[64:data])
    for patch in description["patches"] + description.get("smooth_patches", []):
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
    """What the patch has at q = (u, v, kappa, lambda)."""
    return smooth(patch, q) if "step" in patch else boxes(patch, q)


def boxes(patch, q):
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


def square(kappa, lam, directions):
    """(s, t) of a direction, or None where (kappa, lambda) is none."""
    x, y = 2 * kappa - 1, 2 * lam - 1
    r = np.hypot(x, y)
    if r > 1:
        return None
    if directions == "equal-area":
        x, y = np.array([x, y]) / np.sqrt(1 + np.sqrt(1 - r * r))
    elif abs(x) > abs(y):
        x, y = np.copysign(r, x), np.copysign(r, x) * np.arctan(y / x) * 4 / np.pi
    elif y != 0:
        x, y = np.copysign(r, y) * np.arctan(x / y) * 4 / np.pi, np.copysign(r, y)
    return (x + 1) / 2, (y + 1) / 2


def whole_numbers(section):
    """Of LEB128, seven bits a byte, low ones first, and zigzag: 0, -1, 1, -2, ..."""
    last = np.flatnonzero(section < 128)
    first = np.concatenate([[0], last[:-1] + 1])
    place = np.arange(len(section)) - np.repeat(first, last - first + 1)
    z = np.add.reduceat((section & 127).astype(np.int64) << 7 * place, first)
    return z >> 1 ^ -(z & 1)


def smooth(patch, q):
    """The polynomials of the leaf that holds q; cells come in preorder."""
    st = square(*q[2:], patch["basis"]["directions"])
    if st is None:
        return np.zeros(3)
    values, at = whole_numbers(patch["quanta"]).reshape(-1, 3), 0
    # Cells still to come: of position (0) or direction (1), each [level, m_x, m_y].
    shape, cells = iter(patch["shape"].tolist()), [(0, ([0, 0, 0], [0, 0, 0]))]
    while cells:
        axis, cell = cells.pop()
        byte = next(shape)
        if byte == 0:
            for half in (3, 2, 1, 0):
                level, x, y = cell[axis]
                child = [level + 1, 2 * x + half % 2, 2 * y + half // 2]
                cells.append((axis, (child, cell[1]) if axis == 0 else (cell[0], child)))
        elif byte == 1 and axis == 0:
            cells.append((1, cell))
        elif byte >= 8:
            orders = (byte >> 4) + 1, (byte & 7) + 1
            p, n = (order * (order + 1) // 2 for order in orders)
            both = [functions(*pair) for pair in zip((q[:2], st), cell, orders)]
            if both[0] is not None and both[1] is not None:
                b = values[at : at + p * n].reshape(p, n, 3)
                return patch["step"] * np.einsum("i,k,ikc", *both, b)
            at += p * n
    return np.zeros(3)


def functions(point, cell, order):
    """The cell's products of two polynomials at the point, by total degree; None outside."""
    side = 2 ** cell[0]
    at = np.clip(np.array(point) * side, 0, side)
    own = np.minimum(np.floor(at), side - 1)
    if tuple(own) != tuple(cell[1:]):
        return None
    norm = np.sqrt(2 * np.arange(order) + 1)
    x, y = np.polynomial.legendre.legvander(2 * (at - own) - 1, order - 1) * norm
    return side * np.array([x[d - j] * y[j] for d in range(order) for j in range(d + 1)])


if __name__ == "__main__":
    patch = read(sys.argv[1])[sys.argv[2]]
    for line in sys.stdin:
        print(*map(repr, map(float, radiance(patch, [float(x) for x in line.split()]))))
