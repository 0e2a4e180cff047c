"""Writes the chapel: chapel.gltf, chapel.bin and its textures.

Run in any folder: `python3 scenes/chapel/generate.py` (numpy and Pillow).
Metres, +Y up, the window in the end wall at -Z; the floor to be lit is 4 x 4 m
about the origin.  Seeds are fixed: the same files come out every time.
"""
import os
import sys
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.dirname(HERE)]
import glass  # noqa: E402
import stone  # noqa: E402
from wrtgltf import Gltf, Mesh, digits, floor_rectangle, look_at, rectangle, unit  # noqa: E402

WINDOW = 1.6                       # side of the window
SILL = 1.2                         # its bottom above the floor
GLASS_Z, END, BACK = -2.2, -2.0, 6.5  # glass, inner faces of the end walls
AISLE, INNER, OUTER = 3.4, 2.2, 2.6   # half widths: room, arcade wall's faces
CAPITAL, EAVE, RIDGE = 1.95, 3.3, 5.0
PILLAR_Z = (END + (BACK - END) / 3, END + (BACK - END) * 2 / 3)
STRENGTH = 22.0
AMBIENT = [0.08, 0.08, 0.09]


def pointed(half, rise, steps=14):
    """Points (x, y) of a pointed arch from (-half, 0) over (0, rise), and the
    normals that point inwards (down): two halves, from left to right.

    Two circles of a lancet 1.3 times as high as half its width, stretched."""
    high = 1.3 * half
    r = (half * half + high * high) / (2 * half)  # centres on the springing line
    a = np.linspace(0, np.arcsin(high / r), steps + 1)
    f = rise / high
    left = np.stack([r - half - r * np.cos(a), f * r * np.sin(a)], 1)
    ln = np.stack([np.cos(a), -np.sin(a) / f], 1)
    ln /= np.linalg.norm(ln, axis=1, keepdims=True)
    left[-1, 0] = 0
    return (left, ln), (left[::-1] * [-1, 1], ln[::-1] * [-1, 1])


def arch(mesh, half, rise, place, depth, thick):
    """A pointed arch of rectangular section: soffit, back and two faces.

    `place(x, y, d)` puts a point of the arch's plane at depth d in the room,
    d growing towards the viewer who sees x to the right."""
    origin = np.array(place(0, 0, 0))
    vec = lambda v: np.array(place(v[0], v[1], 0)) - origin
    toward = np.array(place(0, 0, 1)) - origin
    for pts, nrm in pointed(half, rise):
        out = pts - nrm * thick
        if pts[0][0] < 0:  # mitre the two halves at the ridge
            out[-1] = [0, pts[-1][1] + thick / -nrm[-1][1]]
        else:
            out[0] = [0, pts[0][1] + thick / -nrm[0][1]]
        f = lambda q, d: [place(x, y, d) for x, y in q]
        down = [vec(v) for v in nrm]
        mesh.strip(f(pts, depth), f(pts, 0), down)
        mesh.strip(f(out, 0), f(out, depth), [-v for v in down])
        mesh.strip(f(out, depth), f(pts, depth), [toward] * len(pts))
        mesh.strip(f(pts, 0), f(out, 0), [-toward] * len(pts))


def end_wall(m):
    h, top = WINDOW / 2, SILL + WINDOW
    # splayed reveal: the opening is wider at the wall's face, most at the sill
    a, b, c = h + 0.25, SILL - 0.5, top + 0.08
    for pts in ([(-AISLE, 0), (AISLE, 0), (AISLE, b), (-AISLE, b)],
                [(-AISLE, b), (-a, b), (-a, c), (-AISLE, c)],
                [(a, b), (AISLE, b), (AISLE, c), (a, c)],
                [(-AISLE, c), (AISLE, c), (AISLE, EAVE), (-AISLE, EAVE)]):
        m.polygon([(x, y, END) for x, y in pts])
    z0, z1 = GLASS_Z, END
    m.polygon([(-a, b, z1), (a, b, z1), (h, SILL, z0), (-h, SILL, z0)])
    m.polygon([(-h, top, z0), (h, top, z0), (a, c, z1), (-a, c, z1)])
    m.polygon([(-a, c, z1), (-a, b, z1), (-h, SILL, z0), (-h, top, z0)])
    m.polygon([(h, top, z0), (h, SILL, z0), (a, b, z1), (a, c, z1)])
    gable(m, END, 1)


def gable(m, z, side):
    (l, _), (r, _) = pointed(INNER, RIDGE - EAVE)
    row = np.vstack([l, r[1:]])
    for k in range(len(row) - 1):
        tri = [(0, EAVE), (row[k + 1][0], EAVE + row[k + 1][1]), (row[k][0], EAVE + row[k][1])]
        if abs(row[k][1]) + abs(row[k + 1][1]) > 0:
            m.polygon([(x, y, z) for x, y in tri][::side])


def walls():
    m = Mesh()
    end_wall(m)
    m.polygon([(AISLE, 0, BACK), (-AISLE, 0, BACK), (-AISLE, EAVE, BACK), (AISLE, EAVE, BACK)])
    gable(m, BACK, -1)
    for s in (-1, 1):
        m.polygon([(s * AISLE, 0, BACK), (s * AISLE, 0, END), (s * AISLE, EAVE, END), (s * AISLE, EAVE, BACK)][::-s])
        # a plinth along the wall
        lo, hi = sorted((s * AISLE, s * (AISLE - 0.07)))
        m.box((lo, 0, END), (hi, 0.22, BACK), skip="-y -z +z " + ("-x" if s < 0 else "+x"))
    return m


def ceiling():
    m = Mesh()
    for s in (-1, 1):
        m.polygon([(s * OUTER, EAVE, END), (s * AISLE, EAVE, END), (s * AISLE, EAVE, BACK), (s * OUTER, EAVE, BACK)][::s])
    for pts, nrm in pointed(INNER, RIDGE - EAVE):
        row = lambda z: [(x, EAVE + y, z) for x, y in pts]
        m.strip(row(BACK), row(END), [(x, y, 0) for x, y in nrm])
    return m


def arcade():
    """The two walls on pillars, with three pointed arches each."""
    m = Mesh()
    bay = (BACK - END) / 3
    half = bay / 2 - 0.17
    for s in (-1, 1):
        for b in range(3):
            mid = END + bay * (b + 0.5)
            for pts, nrm in pointed(half, 1.06):
                # local x along z; normals of the soffit point to the opening
                low = lambda x: [(x, CAPITAL + y, mid + u) for u, y in pts]
                high = lambda x: [(x, EAVE, mid + u) for u, _ in pts]
                for x, d in ((s * INNER, -s), (s * OUTER, s)):
                    a, t = (low(x), high(x)) if d < 0 else (high(x), low(x))
                    m.strip(a, t, [(d, 0, 0)] * len(pts))
                m.strip(low(max(s * INNER, s * OUTER)), low(min(s * INNER, s * OUTER)), [(0, y, u) for u, y in nrm])
        ends = [END, *PILLAR_Z, BACK]
        for k, z in enumerate(ends):  # the wall above each pillar
            z0, z1 = max(END, z - 0.17), min(BACK, z + 0.17)
            lo, hi = sorted((s * INNER, s * OUTER))
            if 0 < k < 3:
                m.box((lo, CAPITAL, z0), (hi, EAVE, z1), skip="+y -z +z")
            else:  # a half pillar at the end wall
                m.box((lo, 0, z0), (hi, EAVE, z1), skip="+y -y " + ("-z" if k == 0 else "+z"))
    return m


def trim():
    """Ribs under the vault, the window's frame and the hood over it."""
    m = Mesh()
    for z in PILLAR_Z:
        arch(m, INNER - 0.1, RIDGE - EAVE - 0.1, lambda x, y, d: (x, EAVE + y, z - 0.1 + d), 0.2, 0.1)
    arch(m, 1.22, 1.2, lambda x, y, d: (x, SILL + WINDOW + 0.16 + y, END + d), 0.09, 0.12)
    a, b, c = WINDOW / 2 + 0.25, SILL - 0.5, SILL + WINDOW + 0.08
    w, d = 0.1, 0.05
    m.box((-a - w, b, END), (-a, c, END + d), skip="-z")
    m.box((a, b, END), (a + w, c, END + d), skip="-z")
    m.box((-a - w, c, END), (a + w, c + w, END + d), skip="-z")
    m.box((-a - w - 0.06, b - 0.1, END), (a + w + 0.06, b, END + d), skip="-z")
    for s in (-1, 1):  # corbels below the hood's feet, a string course at the eaves
        lo, hi = sorted((s * 1.2, s * 1.36))
        m.box((lo, SILL + WINDOW + 0.02, END), (hi, SILL + WINDOW + 0.16, END + 0.11), skip="-z")
        lo, hi = sorted((s * INNER, s * (INNER - 0.12)))
        m.box((lo, EAVE - 0.12, END), (hi, EAVE, BACK), skip="-z +z " + ("-x" if s < 0 else "+x"))
    return m


def pillar():
    m = Mesh()
    m.box((-0.3, 0, -0.3), (0.3, 0.12, 0.3), skip="-y")
    a = np.linspace(-np.pi / 2, np.pi / 2, 7)
    torus = [(0.235 + 0.045 * np.cos(t), 0.165 + 0.045 * np.sin(t)) for t in a]
    bell = [(0.185 + 0.085 * t ** 2.2, 1.62 + 0.2 * t) for t in np.linspace(0, 1, 7)]
    ring = [(0.18 + 0.03 * np.cos(t), 1.585 + 0.03 * np.sin(t)) for t in a]
    prof = [*torus, (0.215, 0.22), (0.19, 0.27), (0.172, 1.555), *ring, *bell, (0.27, 1.84)]
    m.lathe(prof, 32)
    m.box((-0.29, 1.84, -0.29), (0.29, 1.95, 0.29))
    return m


def font():
    m = Mesh()
    m.lathe([(0.36, 0), (0.36, 0.1), (0.3, 0.1), (0.3, 0.17), (0, 0.17)], 8, crease=0.1)
    m.lathe([(0.2, 0.17), (0.17, 0.24), (0.135, 0.32), (0.125, 0.48), (0.15, 0.58), (0.24, 0.66), (0.32, 0.74),
             (0.36, 0.83), (0.37, 0.93), (0.38, 0.93), (0.38, 0.98), (0.32, 0.98), (0.3, 0.9), (0.22, 0.82), (0, 0.8)], 40)
    return m


def candlestick():
    m = Mesh()
    a = np.linspace(-np.pi / 2, np.pi / 2, 7)
    knop = lambda y, r: [(0.014 + r * np.cos(t), y + r * np.sin(t)) for t in a]
    m.lathe([(0.15, 0), (0.15, 0.02), (0.12, 0.05), (0.05, 0.08), (0.022, 0.14), *knop(0.3, 0.03), (0.016, 0.36),
             (0.016, 0.62), *knop(0.68, 0.035), (0.016, 0.74), (0.016, 1.02), (0.03, 1.08), (0.09, 1.12), (0.095, 1.14),
             (0.03, 1.13), (0.03, 1.16), (0, 1.16)], 24)
    return m


def candle():
    m = Mesh()
    m.lathe([(0.024, 1.16), (0.024, 1.40), (0.02, 1.41), (0, 1.405)], 16)
    return m


def flame():
    m = Mesh()
    m.lathe([(0.0, 1.415), (0.009, 1.425), (0.013, 1.445), (0.009, 1.475), (0, 1.51)], 12, crease=2)
    return m


def urn():
    m = Mesh()
    m.box((-0.2, 0, -0.2), (0.2, 0.06, 0.2), skip="-y")
    m.box((-0.16, 0.06, -0.16), (0.16, 0.62, 0.16), skip="-y")
    m.box((-0.2, 0.62, -0.2), (0.2, 0.68, 0.2))
    m.lathe([(0.1, 0.68), (0.1, 0.7), (0.05, 0.73), (0.04, 0.77), (0.09, 0.82), (0.16, 0.9), (0.19, 1.0), (0.175, 1.09),
             (0.11, 1.16), (0.085, 1.2), (0.1, 1.23), (0.14, 1.25), (0.14, 1.27), (0.1, 1.26), (0.07, 1.2), (0, 1.15)], 32)
    return m


def pew(width=1.5):
    m = Mesh()
    w = width / 2
    for s in (-1, 1):
        lo, hi = sorted((s * w, s * (w - 0.05)))
        m.box((lo, 0, -0.22), (hi, 0.62, 0.22), skip="-y")
        m.box((lo, 0.62, 0.12), (hi, 0.95, 0.22), skip="-y")
    m.box((-w + 0.05, 0.40, -0.2), (w - 0.05, 0.45, 0.16), skip="-x +x")
    m.box((-w + 0.05, 0.45, 0.15), (w - 0.05, 0.9, 0.19), skip="-x +x")
    m.box((-w + 0.05, 0.06, 0.12), (w - 0.05, 0.40, 0.15), skip="-x +x")
    return m


def sphere(r=0.24, y=0.3):
    m = Mesh()
    m.lathe([(0.16, 0), (0.16, 0.03), (0.1, 0.06), (0.085, 0.09), (0.1, 0.1), (0, 0.1)], 32)
    m.lathe([(r * np.sin(t), y - r * np.cos(t)) for t in np.linspace(0, np.pi, 25)], 48, crease=1)
    return m


def corona():
    """A ring of candles hanging from the vault, about the origin."""
    m = Mesh()
    a = np.linspace(0, 2 * np.pi, 9)
    m.lathe([(0.42 + 0.018 * np.cos(t), 0.018 * np.sin(t)) for t in a], 40, crease=1)
    for k in range(3):
        bar = Mesh()
        bar.box((-0.42, -0.008, -0.008), (0.42, 0.008, 0.008))
        m.join(bar.moved((0, 0, 0), np.pi * k / 3))
    for k in range(6):
        cup = Mesh()
        cup.lathe([(0, 0.0), (0.03, 0.02), (0.04, 0.05), (0.025, 0.045), (0, 0.045)], 12)
        m.join(cup.moved((0.42 * np.sin(np.pi * k / 3 + .3), 0.01, 0.42 * np.cos(np.pi * k / 3 + .3))))
    m.lathe([(0, -0.04), (0.03, -0.015), (0.03, 0.02), (0.008, 0.04), (0.008, RIDGE - 3.05)], 12)
    return m


def corona_candles():
    m = Mesh()
    for k in range(6):
        c = Mesh()
        c.lathe([(0.017, 0.055), (0.017, 0.19), (0, 0.195)], 10)
        m.join(c.moved((0.42 * np.sin(np.pi * k / 3 + .3), 0.0, 0.42 * np.cos(np.pi * k / 3 + .3))))
    return m


def phong(kd, ks, n):
    return {"wrt": {"phong": {"kd": kd, "ks": ks, "n": n}}}


def build():
    print("window.png: mean linear RGB", glass.window(os.path.join(HERE, "window.png")).round(3))
    stone.masonry(os.path.join(HERE, "wall.png"), 3)
    stone.masonry(os.path.join(HERE, "flags.png"), 5, rows=4, per_row=(3, 3), joint=0.006, tone=0.7, vary=0.06)
    stone.wood(os.path.join(HERE, "wood.png"), 7)

    g = Gltf("chapel")
    g.doc["scenes"][0]["extras"] = {"wrt": {"ambient": AMBIENT}}

    def material(name, kd, ks, n, texture=None, metallic=0.0, base=None, **more):
        rough = float(np.sqrt(np.sqrt(2 / (n + 2))))
        pbr = {"baseColorFactor": [*(base or kd), 1.0], "metallicFactor": metallic, "roughnessFactor": round(rough, 4)}
        if texture is not None:
            pbr["baseColorTexture"] = {"index": texture}
        return g.put("materials", {"name": name, "pbrMetallicRoughness": pbr, "extras": phong(kd, ks, n), **more})

    light, wall_t, flag_t, wood_t = (g.texture(f) for f in ("window.png", "wall.png", "flags.png", "wood.png"))
    diffuse = material("tile_diffuse", [0.78, 0.73, 0.64], [0.1, 0.1, 0.1], 8)
    specular = material("tile_specular", [0.1, 0.1, 0.12], [0.6, 0.6, 0.6], 40, metallic=0.9, base=[0.62, 0.62, 0.64])
    masonry = material("masonry", [0.78, 0.74, 0.68], [0.02, 0.02, 0.02], 6, wall_t)
    plaster = material("plaster", [0.62, 0.6, 0.57], [0.0, 0.0, 0.0], 4, wall_t)
    dressed = material("dressed_stone", [0.72, 0.66, 0.57], [0.05, 0.05, 0.05], 12)
    flags = material("flags", [0.42, 0.4, 0.38], [0.05, 0.05, 0.05], 12, flag_t)
    oak = material("oak", [0.36, 0.24, 0.15], [0.06, 0.06, 0.06], 20, wood_t)
    brass = material("brass", [0.2, 0.13, 0.045], [0.62, 0.44, 0.18], 60, metallic=1.0, base=[0.78, 0.56, 0.24])
    marble = material("marble", [0.68, 0.67, 0.66], [0.14, 0.14, 0.14], 50)
    bronze = material("bronze", [0.2, 0.32, 0.27], [0.4, 0.38, 0.3], 60, metallic=0.6, base=[0.4, 0.45, 0.36])
    wax = material("wax", [0.8, 0.74, 0.6], [0.04, 0.04, 0.04], 10)
    strength = lambda v: {"KHR_materials_emissive_strength": {"emissiveStrength": v}}
    g.extension("KHR_materials_emissive_strength")
    glow = material("stained_glass", [0.02, 0.02, 0.02], [0.0, 0.0, 0.0], 1, emissiveTexture={"index": light},
                    emissiveFactor=[1.0, 1.0, 1.0], extensions=strength(STRENGTH))
    down = float(np.sqrt(0.5))
    g.doc["materials"][glow]["extras"]["wrt"]["emission"] = {"exponent": 4, "peak": digits([0, -down, down])}
    # the flames are drawn as pale wax; their light is the point lights'
    fire = material("flame", [1.0, 0.85, 0.5], [0.0, 0.0, 0.0], 1)

    # the floor: 16 tiles of 1 m, each a node and a mesh of its own
    tile = g.geometry(floor_rectangle(1, 1), textured=False)
    for row in range(4):
        for col in range(4):
            name = f"tile_{row}{col}"
            mesh = g.mesh(name, tile, (diffuse, specular)[(row + col) % 2])
            g.node(name, mesh=mesh, translation=[col - 1.5, 0.0, row - 1.5], extras={"wrt": {"receiver": True}})

    pane = g.mesh("window", rectangle(WINDOW, WINDOW), glow)
    g.node("window", mesh=pane, translation=[0.0, SILL + WINDOW / 2, GLASS_Z])

    around = Mesh()
    for x0, x1, z0, z1 in ((-AISLE, -2, END, BACK), (2, AISLE, END, BACK), (-2, 2, 2, BACK)):
        around.polygon([(x0, 0, z1), (x1, 0, z1), (x1, 0, z0), (x0, 0, z0)])

    def thing(name, mesh, mat, at=(0, 0, 0), turn=0.0):
        fields = {}
        if any(at):
            fields["translation"] = digits(at, 5)
        if turn:
            fields["rotation"] = digits([0, np.sin(turn / 2), 0, np.cos(turn / 2)])
        index = mesh if isinstance(mesh, int) else g.mesh(name, mesh, mat)
        g.node(name, mesh=index, **fields)
        return index

    thing("floor_around", around, flags)
    thing("walls", walls(), masonry)
    thing("ceiling", ceiling(), plaster)
    thing("arcade", arcade(), masonry)
    thing("trim", trim(), dressed)
    index = pillar()
    for k, (s, z) in enumerate([(s, z) for z in PILLAR_Z for s in (-1, 1)]):
        index = thing(f"pillar_{k}", index, dressed, (s * (INNER + OUTER) / 2, 0, z))
    thing("font", font(), dressed, (-1.32, 0, 2.6))
    thing("urn", urn(), marble, (2.75, 0, -0.6))
    thing("sphere", sphere(), bronze, (1.5, 0, 2.4))
    index = pew()
    for k, (x, z, turn) in enumerate([(-1.25, 4.45, 0), (1.25, 4.45, 0), (-3.05, 0.0, np.pi / 2 * 3), (3.05, 2.25, np.pi / 2)]):
        index = thing(f"pew_{k}", index, oak, (x, 0, z), turn)
    stick, wick, fl = candlestick(), candle(), flame()
    g.extension("KHR_lights_punctual")
    g.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"name": "candle", "type": "point", "color": [1.0, 0.62, 0.28], "intensity": 0.4},
        {"name": "corona", "type": "point", "color": [1.0, 0.78, 0.52], "intensity": 2.0}]}}
    for k, x in enumerate((-2.28, 2.28)):
        stick = thing(f"candlestick_{k}", stick, brass, (x, 0, -1.5))
        wick = thing(f"candle_{k}", wick, wax, (x, 0, -1.5))
        fl = thing(f"flame_{k}", fl, fire, (x, 0, -1.5))
        g.node(f"candle_light_{k}", translation=[x, 1.56, -1.5], extensions={"KHR_lights_punctual": {"light": 0}})

    at = (0, 3.05, 4.2)
    thing("corona", corona(), brass, at)
    thing("corona_candles", corona_candles(), wax, at)
    g.node("corona_light", translation=[0.0, 2.9, 4.2], extensions={"KHR_lights_punctual": {"light": 1}})

    g.camera("nave", (0.42, 2.25, 6.2), (-0.02, 1.06, -2.0), 46)
    g.camera("window", (0.0, 2.35, 1.5), (0.0, 2.02, -2.2), 40)
    g.camera("low", (-0.72, 0.6, 1.85), (0.05, 0.82, -2.0), 58)
    g.camera("top", (0.0, 4.6, 0.5), (0.0, 0.0, 0.0), 60)
    flight(g)
    g.save(os.path.join(HERE, "chapel.gltf"), "chapel.bin")
    print("chapel.gltf:", sum(len(m["primitives"]) for m in g.doc["meshes"]), "meshes,", len(g.doc["nodes"]), "nodes,", len(g.bin), "bytes of data")


def flight(g):
    """Ten seconds once round the floor, back to the start."""
    stops = [((0.95, 1.62, 5.4), (0, 1.25, -2)), ((1.75, 1.4, 3.3), (-0.2, 0.8, -1.2)), ((1.8, 1.1, 0.9), (-0.5, 0.5, -1.0)),
             ((1.55, 1.5, -1.2), (-0.9, 0.1, 0.6)), ((0.0, 2.0, -1.55), (0.0, 0.0, 1.2)), ((-1.55, 1.6, -1.1), (0.9, 0.1, 0.4)),
             ((-1.75, 1.0, 0.8), (0.5, 0.6, -1.3)), ((-0.6, 0.8, 2.4), (0.1, 0.95, -2)), ((0.0, 1.3, 4.1), (0, 1.2, -2)),
             ((0.95, 1.62, 5.4), (0, 1.25, -2))]
    key = np.array([np.concatenate(s) for s in stops], float)
    n = len(key)
    times = np.linspace(0, 10, 61)
    rows = []
    for t in times:  # Catmull-Rom through the stops, sampled finely enough for LINEAR
        f = t / 10 * (n - 1)
        i = min(int(f), n - 2)
        u = f - i
        p = [key[(k % (n - 1))] for k in (i - 1, i, i + 1, i + 2)]
        rows.append(0.5 * (2 * p[1] + (p[2] - p[0]) * u + (2 * p[0] - 5 * p[1] + 4 * p[2] - p[3]) * u ** 2
                           + (3 * p[1] - p[0] - 3 * p[2] + p[3]) * u ** 3))
    rows = np.array(rows)
    quat = np.array([look_at(r[:3], r[3:]) for r in rows])
    for k in range(1, len(quat)):
        if quat[k] @ quat[k - 1] < 0:
            quat[k] = -quat[k]
    node = g.camera("fly", rows[0][:3], rows[0][3:], 50)
    time = g.data(times.astype(np.float32), "SCALAR", bounds=True)
    move = g.data(rows[:, :3].astype(np.float32), "VEC3")
    turn = g.data(quat.astype(np.float32), "VEC4")
    g.put("animations", {"name": "flight",
                         "samplers": [{"input": time, "interpolation": "LINEAR", "output": o} for o in (move, turn)],
                         "channels": [{"sampler": 0, "target": {"node": node, "path": "translation"}},
                                      {"sampler": 1, "target": {"node": node, "path": "rotation"}}]})


if __name__ == "__main__":
    build()
