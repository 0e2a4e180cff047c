"""Paints the stained-glass window: `python3 glass.py [window.png] [size]`.

A rose of twelve petals in a square, warm (ruby, gold) on the left and cold
(cobalt, green) on the right, so that the light it throws is coloured too.

Painter's algorithm on signed distances: each shape overwrites the panes below
it and is outlined by its own lead; cuts then divide a shape into panes.  The
colour is chosen once per pane, and the glass is given streaks, bubbles and
grime at the leads.  Everything is drawn at twice the size and averaged down.
"""
import sys
import numpy as np
from PIL import Image

# sRGB colours of the glass, by role; left (warm) and right (cold) halves.
PALETTE = {
    "field": ([(196, 16, 30), (168, 10, 34), (214, 44, 26), (150, 14, 62)],
              [(22, 58, 200), (14, 40, 168), (24, 92, 206), (44, 34, 160)]),
    "petal": ([(226, 30, 34), (236, 74, 24), (206, 20, 48)],
              [(30, 84, 226), (20, 62, 206), (16, 120, 206)]),
    "gold": ([(255, 190, 52), (250, 160, 34), (255, 208, 92)],
             [(255, 206, 84), (246, 216, 120), (240, 196, 70)]),
    "leaf": ([(120, 140, 30), (214, 120, 26), (178, 148, 40)],
             [(18, 138, 84), (22, 150, 120), (44, 158, 70)]),
    "pale": ([(255, 236, 206), (255, 224, 180)],
             [(214, 234, 248), (226, 242, 240)]),
    "violet": ([(150, 30, 96), (128, 26, 110)], [(92, 44, 168), (66, 52, 178)]),
}
ROLES = list(PALETTE)
THIN = 0.78  # of all leads


def smoothstep(a, b, x):
    t = np.clip((x - a) / (b - a), 0, 1)
    return t * t * (3 - 2 * t)


class Noise:
    """Smooth value noise in about [-1, 1], sampled anywhere."""

    def __init__(self, rng, n=128):
        self.n, self.g = n, rng.uniform(-1, 1, (n, n)).astype(np.float32)

    def __call__(self, x, y):
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        u, v = (x - i).astype(np.float32), (y - j).astype(np.float32)
        u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
        at = lambda a, b: self.g[a % self.n, b % self.n]
        return ((at(i, j) * (1 - u) + at(i + 1, j) * u) * (1 - v)
                + (at(i, j + 1) * (1 - u) + at(i + 1, j + 1) * u) * v)


class Glass:
    def __init__(self, size, seed):
        self.rng = np.random.default_rng(seed)
        self.noise = Noise(self.rng)
        a = ((np.arange(size) + 0.5) / size * 2 - 1).astype(np.float32)
        x, y = np.meshgrid(a, -a)
        self.x, self.y = x, y
        # hand-made: all lines waver a little
        self.wx = x + 0.006 * self.noise(x * 5 + 3, y * 5) + 0.002 * self.noise(x * 19, y * 19)
        self.wy = y + 0.006 * self.noise(x * 5 + 40, y * 5 + 9) + 0.002 * self.noise(x * 19 + 7, y * 19)
        self.pane = np.zeros((size, size), np.int64)
        self.role = np.zeros((size, size), np.int8)
        self.lead = np.full((size, size), 9, np.float32)  # < 0 is lead
        self.paint = np.full((size, size), 9, np.float32)  # < 0 is painted line
        self.n = 1

    def shape(self, sdf, half, role, index=0):
        """A shape (sdf < 0) of panes numbered by `index`, outlined with lead."""
        half = half * THIN
        m = sdf < 0
        self.lead[m] = 9
        self.paint[m] = 9
        self.lead = np.minimum(self.lead, np.abs(sdf) - half)
        index = np.broadcast_to(index, m.shape)
        self.pane[m] = self.n * 100000 + index[m]
        self.role[m] = ROLES.index(role)
        self.n += 1
        return m

    def cut(self, mask, distance, half, index=None):
        """A lead line where `distance` is zero inside a mask; splits panes."""
        line = np.where(mask, np.abs(distance) - half * THIN, 9)
        self.lead = np.minimum(self.lead, line)
        if index is not None:
            self.pane[mask] += np.broadcast_to(index, mask.shape)[mask] * 1000

    def set_role(self, mask, role):
        self.role[mask] = ROLES.index(role)

    def stroke(self, mask, distance, half):
        """A line painted on the glass (brown, not opaque)."""
        self.paint = np.minimum(self.paint, np.where(mask, np.abs(distance) - half, 9))

    def voronoi(self, points):
        """Index of the nearest point and distance to the cell's edge."""
        d1 = np.full(self.x.shape, 99, np.float32)
        d2 = d1.copy()
        i1 = np.zeros(self.x.shape, np.int32)
        i2 = i1.copy()
        for k, (px, py) in enumerate(points):
            d = (self.wx - px) ** 2 + (self.wy - py) ** 2
            near, second = d < d1, d < d2
            i2 = np.where(near, i1, np.where(second, k, i2))
            d2 = np.where(near, d1, np.where(second, d, d2))
            i1, d1 = np.where(near, k, i1), np.where(near, d, d1)
        p = np.asarray(points, np.float32)
        gap = np.hypot(*np.moveaxis(p[i1] - p[i2], -1, 0)) + 1e-6
        return i1, (d2 - d1) / (2 * gap)


def sectors(g, n, turn=0.0):
    """Sector number, and (along, across) coordinates about its middle line."""
    step = 2 * np.pi / n
    a = np.arctan2(g.wx, g.wy) / step - turn
    k = np.round(a)
    a = (a - k) * step
    r = np.hypot(g.wx, g.wy)
    return (k.astype(int)) % n, r * np.cos(a), r * np.sin(a), r


def foil(x, y, lobes, r, turn=0.0):
    """Signed distance of a multifoil: `lobes` circles around a centre."""
    d = np.hypot(x, y) - r * 0.62
    for i in range(lobes):
        a = 2 * np.pi * (i + turn) / lobes
        d = np.minimum(d, np.hypot(x - 0.56 * r * np.sin(a), y - 0.56 * r * np.cos(a)) - 0.44 * r)
    return d


def draw(g):
    rng = g.rng
    # ground: jittered cells, the spandrels outside the rose
    m = 13
    pts = [((i + rng.uniform(.15, .85)) / m * 2 - 1, (j + rng.uniform(.15, .85)) / m * 2 - 1)
           for i in range(m) for j in range(m)]
    cell, edge = g.voronoi(pts)
    square = np.maximum(np.abs(g.wx), np.abs(g.wy))
    ground = g.shape(square - 0.99, 0.02, "field", cell)
    g.cut(ground, edge, 0.0055)
    pick = rng.integers(0, 9, len(pts))[cell]
    g.set_role(ground & (pick == 0), "leaf")
    g.set_role(ground & (pick == 1), "violet")
    g.set_role(ground & (pick == 2), "gold")

    # border: a band of small panes, lozenges between bars
    band = (square > 0.868) & (square < 0.99)
    along = np.where(np.abs(g.wx) > np.abs(g.wy), g.wy, g.wx)
    side = (np.abs(g.wx) > np.abs(g.wy)) * 2 + (np.where(np.abs(g.wx) > np.abs(g.wy), g.wx, g.wy) > 0)
    n = 14
    t = (along / 0.868 + 1) * n / 2
    k = np.floor(t)
    g.lead[band] = 9
    g.pane[band] = (90_000_000 + side * 100 + k + 1)[band]
    g.set_role(band & (k % 2 == 0), "field")
    g.set_role(band & (k % 2 != 0), "leaf")
    g.cut(band, (t - np.round(t)) * 2 * 0.868 / n, 0.006)
    mid, half = 0.929, 0.868 / n
    lozenge = (np.abs(t - k - 0.5) * 2 * half + np.abs(square - mid)) - 0.05
    inside = band & (np.abs(along) < 0.868)
    loz = np.where(inside, lozenge * 0.707, 9)
    g.shape(np.where(k % 2 == 0, loz, 9), 0.005, "gold", (side * 100 + k).astype(int))
    g.shape(np.where(k % 2 != 0, loz + 0.008, 9), 0.005, "pale", (side * 100 + k).astype(int))
    corner = np.maximum(np.abs(np.abs(g.wx) - mid), np.abs(np.abs(g.wy) - mid)) - 0.061
    g.shape(corner, 0.007, "violet", side)
    g.shape(np.hypot(np.abs(g.wx) - mid, np.abs(g.wy) - mid) - 0.036, 0.005, "pale", side)
    g.lead = np.minimum(g.lead, np.abs(square - 0.868) - 0.011)

    # roundels in the four corners of the square
    qx, qy = np.abs(g.wx) - 0.7, np.abs(g.wy) - 0.7
    quad = (g.wx > 0) * 2 + (g.wy > 0)
    g.shape(np.hypot(qx, qy) - 0.15, 0.011, "gold", quad * 10)
    a = np.arctan2(qx, qy) / (np.pi / 4)
    ring = np.hypot(qx, qy) < 0.15
    g.cut(ring, (a - np.floor(a) - 0.5) * np.hypot(qx, qy) * np.pi / 4, 0.004, np.round(a).astype(int) % 8)
    four = g.shape(foil(qx, qy, 4, 0.118), 0.007, "petal", quad * 10)
    g.stroke(four, np.hypot(qx, qy) - 0.074, 0.0022)
    g.shape(np.hypot(qx, qy) - 0.04, 0.006, "pale", quad)

    # the rose: a wheel of 24 outer lights
    k, s, t, r = sectors(g, 24, 0.5)
    outer = g.shape(r - 0.842, 0.017, "field", k)
    g.cut(outer, np.abs(t) - s * np.tan(np.pi / 24), 0.007)
    # each with a pointed head: a pale fillet about a light in three panes
    head = np.sqrt(np.clip((0.822 - s) / 0.13, 0, 1))
    bar = np.where((s > 0.6) & (s < 0.823), (np.abs(t) - np.minimum(0.08 * head, s * 0.115)) * 0.85, 9)
    rim = g.shape(bar, 0.006, "gold", k)
    jog = rng.uniform(-.012, .012, 24)[k]
    g.cut(rim, s - 0.715 - jog, 0.0035, ((s > 0.715 + jog) * 2 + (t > 0)).astype(int))
    light = g.shape(bar + 0.017, 0.005, "petal", k)
    g.set_role(light & (k % 3 == 1), "violet")
    g.set_role(light & (k % 3 == 2), "leaf")
    low = s - 0.688 - jog + 0.4 * np.abs(t)
    high = s - 0.742 + jog + 0.4 * np.abs(t)
    g.cut(light, low, 0.004, (low > 0).astype(int))
    g.cut(light, high, 0.004, (high > 0).astype(int))
    g.set_role(light & (low > 0) & (high < 0), "field")
    g.stroke(light & (low > 0) & (high < 0), np.hypot(s - 0.708, t) - 0.014, 0.0016)
    # an eyelet between every two heads
    ke, se, te, _ = sectors(g, 24)
    g.shape(np.where(se > 0.7, np.hypot(se - 0.806, te) - 0.019, 9), 0.005, "pale", ke)

    # twelve roundels
    k, s, t, r = sectors(g, 12)
    hub = g.shape(r - 0.655, 0.014, "leaf", k)
    g.cut(hub, np.abs(t) - s * np.tan(np.pi / 12), 0.006)
    g.cut(hub, s - 0.545 + 0.3 * np.abs(t), 0.005, (s > 0.545 - 0.3 * np.abs(t)).astype(int))
    g.shape(np.hypot(s - 0.54, t) - 0.104, 0.011, "gold", k)
    a = np.arctan2(t, s - 0.54) / (2 * np.pi / 12)
    d = np.hypot(s - 0.54, t)
    g.cut(d < 0.104, (a - np.round(a)) * d * 2 * np.pi / 12, 0.0038, np.floor(a).astype(int) + 7)
    six = g.shape(foil(s - 0.54, t, 6, 0.083), 0.006, "petal", k)
    g.set_role(six & (k % 2 == 1), "field")
    g.stroke(six, d - 0.053, 0.002)
    for i in range(3):
        c = np.cos(np.pi * (i + .5) / 3) * (s - 0.54) + np.sin(np.pi * (i + .5) / 3) * t
        g.stroke(six & (d > 0.03), c, 0.0014)
    g.shape(d - 0.03, 0.0055, "pale", k)

    # twelve petals about the middle, with veins painted on them
    field = g.shape(r - 0.425, 0.013, "gold", k)
    kk, ss, tt, _ = sectors(g, 12, 0.5)
    g.cut(field, tt, 0.005, kk)
    g.shape(np.where(ss > 0.2, np.hypot(ss - 0.385, tt) - 0.026, 9), 0.005, "pale", kk)
    f = np.clip((s - 0.1) / 0.31, 0, 1)
    leaf = (np.abs(t) - 0.083 * np.maximum(np.sin(np.pi * f ** 1.25), 0) ** 0.8) * 0.85
    petal = g.shape(np.where((s > 0.1) & (s < 0.41), leaf, 9), 0.0085, "petal", k)
    g.set_role(petal & (k % 2 == 1), "field")
    g.cut(petal, s - 0.262 - 0.55 * np.abs(t), 0.0045, (s > 0.262 + 0.55 * np.abs(t)).astype(int) * 2)
    heart = (np.abs(t) - 0.036 * np.sin(np.pi * np.clip((s - 0.265) / 0.12, 0, 1))) * 0.8
    g.shape(np.where((s > 0.265) & (s < 0.385), heart, 9), 0.005, "gold", k)
    g.stroke(petal, t, 0.0016)
    g.stroke(petal, np.abs(t) - 0.55 * (0.39 - s), 0.0014)

    # the sun in the middle
    k, s, t, r = sectors(g, 12, 0.5)
    sun = g.shape(r - 0.168, 0.012, "gold", k)
    g.cut(sun, np.abs(t) - s * np.tan(np.pi / 12), 0.0055)
    rays = g.shape(foil(g.wx, g.wy, 8, 0.125), 0.0065, "petal")
    a = np.arctan2(g.wx, g.wy) / (np.pi / 4)
    g.cut(rays, (a - np.floor(a) - 0.5) * r * np.pi / 4, 0.0042, np.round(a).astype(int) % 8)
    core = g.shape(r - 0.062, 0.008, "pale")
    g.stroke(core, r - 0.045, 0.002)
    k, s, t, r = sectors(g, 16)
    g.stroke(core & (r > 0.02) & (r < 0.045), t, 0.0014)


def colour(g):
    """Linear RGB of every pixel."""
    rng, x, y = g.rng, g.x, g.y
    ids, first, pane = np.unique(g.pane, return_index=True, return_inverse=True)
    pane = pane.reshape(x.shape)
    count = np.bincount(pane.ravel())
    cx = np.bincount(pane.ravel(), x.ravel()) / count
    cy = np.bincount(pane.ravel(), y.ravel()) / count
    n = len(ids)
    role = g.role.ravel()[first]
    base = np.zeros((n, 3))
    for p in range(n):
        cold = rng.uniform() < smoothstep(-0.42, 0.42, cx[p] + 0.12 * np.sin(3 * cy[p]))
        shades = PALETTE[ROLES[role[p]]][int(cold)]
        base[p] = shades[rng.integers(len(shades))]
    base = np.where(base / 255 <= 0.04045, base / 255 / 12.92, ((base / 255 + 0.055) / 1.055) ** 2.4)
    base = base ** rng.uniform(0.85, 1.15, (n, 1)) * rng.uniform(0.9, 1.3, (n, 1))
    base = np.maximum(base * rng.uniform(0.92, 1.08, (n, 3)), 0.004)
    # a gradient over each pane, and streaks at the pane's own angle
    angle = rng.uniform(0, 2 * np.pi, n)
    ca, sa = np.cos(angle)[pane], np.sin(angle)[pane]
    dx, dy = x - cx[pane], y - cy[pane]
    along, across = dx * ca + dy * sa, dy * ca - dx * sa
    off = rng.uniform(0, 100, n)[pane]
    size = np.sqrt(count[pane] / count.sum()) * 2
    tone = 1 + rng.uniform(0.1, 0.42, n)[pane] * np.clip(along / size, -1, 1)
    streak = g.noise(along * 7 + off, across * 60 + off) * 0.6 + g.noise(along * 13 + off, across * 150) * 0.4
    tone += rng.uniform(0.05, 0.24, n)[pane] * streak
    tone *= 1 + 0.13 * g.noise(x * 9 + off, y * 9)
    rgb = base[pane].astype(np.float32)
    rgb = rgb ** (1 / np.clip(tone, 0.6, 1.5))[..., None] * np.clip(tone, 0.55, 1.5)[..., None]
    # bubbles: a bright spot with a darker rim
    h = x.shape[0]
    for _ in range(1500):
        bx, by, br = rng.integers(0, h), rng.integers(0, h), rng.uniform(0.0012, 0.0042) * h / 2
        w = int(br * 2) + 2
        j, i = np.mgrid[max(by - w, 0):min(by + w, h), max(bx - w, 0):min(bx + w, h)]
        d = np.hypot((i - bx) / rng.uniform(1, 1.5), j - by) / br
        rgb[j, i] *= (1 + 0.55 * np.exp(-3 * d * d) - 0.28 * np.exp(-12 * (d - 1) ** 2))[..., None]
    # grime towards the leads, painted lines, then the leads themselves
    rgb *= (0.6 + 0.4 * smoothstep(0, 0.016, g.lead))[..., None]
    pixel = 2 / h
    ink = smoothstep(pixel, -pixel, g.paint)[..., None]
    rgb = rgb * (1 - 0.86 * ink) + ink * np.array([0.012, 0.006, 0.003])
    lead = smoothstep(pixel, -pixel, g.lead)[..., None]
    sheen = 0.0025 + 0.0035 * smoothstep(-0.002, -0.012, g.lead)[..., None]
    rgb = rgb * (1 - lead) + lead * sheen * np.array([1, 1, 1.1])
    return np.clip(rgb, 0, 1)


def window(path, size=1024, seed=12):
    g = Glass(size * 2, seed)
    draw(g)
    rgb = colour(g).reshape(size, 2, size, 2, 3).mean((1, 3))
    srgb = np.where(rgb <= 0.0031308, rgb * 12.92, 1.055 * rgb ** (1 / 2.4) - 0.055)
    Image.fromarray(np.uint8(srgb * 255 + 0.5)).save(path, optimize=True)
    return rgb.mean((0, 1))


if __name__ == "__main__":
    path = sys.argv[1] if len(sys.argv) > 1 else "window.png"
    print(path, "mean linear RGB", window(path, int(sys.argv[2]) if len(sys.argv) > 2 else 1024))
