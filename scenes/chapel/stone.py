"""Subtle stone and wood textures (sRGB), made to repeat."""
import numpy as np
from PIL import Image


def noise(rng, size, cells_y, cells_x):
    """Smooth periodic noise in [-1, 1]."""
    g = rng.uniform(-1, 1, (cells_y, cells_x))
    out = g
    for axis, cells in ((0, cells_y), (1, cells_x)):
        x = np.arange(size) / size * cells
        i = np.floor(x).astype(int)
        f = x - i
        f = f * f * (3 - 2 * f)
        f = f[:, None] if axis == 0 else f[None, :]
        out = np.take(out, i % cells, axis) * (1 - f) + np.take(out, (i + 1) % cells, axis) * f
    return out


def masonry(path, seed, size=512, rows=6, per_row=(3, 4), joint=0.008, tone=0.82, vary=0.07, tint=(1, .965, .9), stagger=True):
    """Courses of blocks with joints of mortar."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:size, 0:size] / size
    wob = 0.0025 * noise(rng, size, 24, 24)
    u, v = u + wob, v + 0.0025 * noise(rng, size, 20, 20)
    row = np.floor(v * rows).astype(int) % rows
    value = np.full((size, size), tone)
    warm = np.zeros((size, size))
    depth = np.full((size, size), 1.0)
    for r in range(rows):
        n = per_row[r % len(per_row)]
        cuts = (np.arange(n) + (rng.uniform(-.16, .16, n) if stagger else 0)) / n + (0.5 / n if stagger and r % 2 else 0)
        cuts = np.sort(cuts % 1)
        block = (np.searchsorted(cuts, u.ravel() % 1).reshape(u.shape)) % n
        d = np.min([np.abs((u - c + .5) % 1 - .5) for c in cuts], 0)
        m = row == r
        value[m] += (vary * rng.uniform(-1, 1, n))[block][m]
        warm[m] = rng.uniform(-1, 1, n)[block][m]
        depth[m] = d[m]
    t = v * rows
    depth = np.minimum(depth, np.abs(t - np.round(t)) / rows)
    value += 0.035 * noise(rng, size, 8, 8) + 0.025 * noise(rng, size, 32, 32) + 0.018 * noise(rng, size, 128, 128)
    edge = np.clip((depth - joint * 0.5) / (joint * 0.9), 0, 1)
    value = value * (0.62 + 0.38 * edge * edge * (3 - 2 * edge))
    rgb = value[..., None] * (np.array(tint) + warm[..., None] * np.array([.015, 0, -.025]))
    save(path, rgb)


def wood(path, seed, size=256):
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:size, 0:size] / size
    grain = noise(rng, size, 6, 64) * 0.5 + noise(rng, size, 4, 128) * 0.35 + 0.4 * np.sin(2 * np.pi * (4 * u + 0.25 * noise(rng, size, 3, 4)))
    value = 0.72 + 0.11 * grain
    save(path, value[..., None] * np.array([1, .84, .66]))


def save(path, rgb):
    image = Image.fromarray(np.uint8(np.clip(rgb, 0, 1) * 255 + 0.5))
    image.quantize(128, dither=Image.Dither.NONE).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
