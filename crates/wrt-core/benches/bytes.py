"""Bytes against error: .wct beside zfp, zstd of half floats and plain thresholding.

    pip install numpy zfpy zstandard
    tracer bake scenes/chapel/chapel.gltf --incident --level 5 --threshold 0 --checks 0 -o full.wct
    tracer convert full.wct --raw -o raw.wct
    tracer convert full.wct --error 0.01 -o coded.wct
    python crates/wrt-core/benches/bytes.py raw.wct coded.wct 0.01 PATCH...

All errors are relative L2. zfp has its fixed-accuracy mode, each channel apart, whose
tolerance acts in powers of two: of the two around the error asked for both are shown.
Thresholding keeps the largest coefficients, 2 bytes of mask a node and 4 bytes a
scalar: "grouped" three channels at a time, "channels" each alone with a mask each,
"nodes" whole nodes.

Bytes at 1 %, of the chapel's corner and middle tiles (zfp, of errors around 1 %, as
"bytes at error"); the dense array has 12.6 MB:

                          tile_00.incident   tile_11.incident   tile_00     tile_11
    samples that are 0    96 %               94 %               16 %        16 %
    wct                   39092              69097              41733       31881
    zfp                   161784 at 1.11 %   238264 at 1.02 %   320792      357864
    zfp                   197392 at 0.60 %   286464 at 0.54 %   at 0.98 %   at 0.99 %
    zstd of half floats   208989             319401             2130897     1906011
    thresholded, grouped  430100             662072             2053044     1168608
      channels            384560             585312             1932520     1253888
      nodes               615664             914480             8122440     5073800

Per channel, 11 to 21 % fewer scalars reach the error than grouped, and bytes change by
-12 % to +7 %: not worth masks of their own. Whole nodes take 1.4 to 4.8 times as many.
"""

import os
import sys

import numpy as np
import zfpy
import zstandard

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "../../../tests"))
from read_wct import read

ONES = np.array([bin(i).count("1") for i in range(65536)])


def dense(patch):
    """The means of all finest cells, axes lambda, kappa, v, u, channel."""
    levels = [patch["levels"][d] for d in ("position", "position", "direction", "direction")]
    child_mask, nu_mask = patch["child_mask"].astype(int), patch["nu_mask"].astype(int)
    first_child = 1 + np.concatenate([[0], np.cumsum(ONES[child_mask])])
    first_b = np.concatenate([[0], np.cumsum(ONES[nu_mask])])
    out = np.zeros((1, 1, 1, 1, 3)) + patch["root"]
    nodes, cells = np.arange(min(1, patch["nodes"])), np.zeros((min(1, patch["nodes"]), 4), int)
    for depth in range(max(levels)):
        split = [d for d in range(4) if depth < levels[d]]
        for d in split:
            out = np.repeat(out, 2, axis=3 - d)
        b = np.zeros((len(nodes), 16, 3))
        for nu in range(1, 16):
            has = nu_mask[nodes] >> nu & 1 == 1
            at = first_b[nodes] + ONES[nu_mask[nodes] & ((1 << nu) - 1)]
            b[has, nu] = patch["coefficients"][at[has]]
        scale = 2.0 ** (min(depth, levels[0]) + min(depth, levels[2]))
        next_nodes, next_cells = [], []
        for m in (m for m in range(16) if all(d in split for d in range(4) if m >> d & 1)):
            sign = np.array([(-1.0) ** ONES[nu & m] for nu in range(16)])
            child = cells.copy()
            for d in split:
                child[:, d] = 2 * child[:, d] + (m >> d & 1)
            out[child[:, 3], child[:, 2], child[:, 1], child[:, 0]] += scale * np.einsum("n,inc->ic", sign, b)
            has = child_mask[nodes] >> m & 1 == 1
            next_nodes.append((first_child[nodes] + ONES[child_mask[nodes] & ((1 << m) - 1)])[has])
            next_cells.append(child[has])
        nodes, cells = np.concatenate(next_nodes), np.concatenate(next_cells)
    # Rounding of coefficients leaves dust where there was nothing, which would tell
    # against the rivals.
    out[np.abs(out).max(axis=-1) < 1e-6 * np.abs(out).max()] = 0
    return out.astype(np.float32)


def thresholded(patch, error):
    """Scalars kept and bytes by way of choosing."""
    b = patch["coefficients"].astype(float)
    total = (b**2).sum() + (np.array(patch["root"]) ** 2).sum()
    node = np.repeat(np.arange(patch["nodes"]), ONES[patch["nu_mask"].astype(int)])

    def kept(energies):
        order = np.sort(energies)
        return len(order) - np.searchsorted(np.cumsum(order), error**2 * total, side="right")

    def threshold(energies, count):
        return np.sort(energies)[-count]

    group = (b**2).sum(axis=1)
    by_node = np.bincount(node, group, patch["nodes"])
    n = kept(group)
    alive = np.unique(node[group >= threshold(group, n)]).size
    yield "grouped", 3 * n, 12 * n + 4 * alive
    n = kept((b**2).ravel())
    alive = np.unique(node[((b**2) >= threshold((b**2).ravel(), n)).any(axis=1)]).size
    yield "channels", n, 4 * n + 8 * alive
    n = kept(by_node)
    scalars = 3 * np.isin(node, np.flatnonzero(by_node >= threshold(by_node, n))).sum()
    yield "nodes", scalars, 4 * scalars + 4 * n


def main():
    raw, coded, error = read(sys.argv[1]), read(sys.argv[2], sections=False), float(sys.argv[3])
    for name in sys.argv[4:] or raw:
        a = dense(raw[name])
        norm = np.sqrt((a.astype(float) ** 2).sum())
        print(f"{name}: {100 * (a == 0).mean():.0f} % of {a.size} samples are 0")

        def row(what, size, found):
            print(f"  {what:24} {size:9} bytes  {100 * found:.3f} %", flush=True)

        def error_of(b):
            return np.sqrt(((a.astype(float) - b) ** 2).sum()) / norm

        c = coded[name]
        row("wct", sum(s["nbytes"] for s in c["sections"].values()), c["relative_error"])
        channels = [np.ascontiguousarray(a[..., i]) for i in range(3)]
        for power in range(20, -60, -1):
            packed = [zfpy.compress_numpy(c, tolerance=2.0**power) for c in channels]
            found = error_of(np.stack([zfpy.decompress_numpy(p) for p in packed], -1))
            if found < 2.5 * error:
                row("zfp", sum(map(len, packed)), found)
            if found <= error:
                break
        half = a.astype(np.float16)
        packer = zstandard.ZstdCompressor(level=19)
        planes = np.ascontiguousarray(np.moveaxis(half, -1, 0))
        size = min(len(packer.compress(x.tobytes())) for x in (half, planes))
        row("zstd -19 of half floats", size, error_of(half))
        for what, scalars, size in thresholded(raw[name], error):
            row(f"thresholding, {what}", size, error)
            print(f"    {scalars} scalars")


if __name__ == "__main__":
    main()
