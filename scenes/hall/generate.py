"""Writes the hall: hall.gltf, hall.bin and the picture of its windows.

Run in any folder: `python3 scenes/hall/generate.py` (numpy and Pillow).
Metres, +Y up; twelve windows, six in either long wall (±X), over a floor of
4 x 6 m about the origin, six polished tiles of 2 x 2 m.
"""
import os
import sys
import numpy as np
from PIL import Image

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.dirname(HERE))
from wrtgltf import Gltf, Mesh, digits, floor_rectangle, rectangle  # noqa: E402

HALF, LENGTH, HEIGHT = 2.0, 6.0, 3.4   # half width, length, height of the room
WIDE, HIGH, SILL = 0.6, 1.5, 0.8       # a window, its bottom above the floor
STRENGTH = 6.0


def window_picture(path, width=128, height=256):
    """Lozenges of pale glass in lead, each of its own tint, brighter to the top."""
    y, x = np.mgrid[0:height, 0:width]
    x, y = (x + 0.5) / width * 4, (y + 0.5) / height * 4 * HIGH / WIDE
    a, b = x + y / 1.6, x - y / 1.6
    i, j = np.floor(a).astype(int), np.floor(b).astype(int)
    lead = (np.abs(a - i - 0.5) > 0.455) | (np.abs(b - j - 0.5) > 0.455)
    border = (np.abs(x - 2) > 1.86) | (y < 0.14) | (y > y.max() - 0.14)
    tint = np.random.default_rng(12).random((64, 64, 3)) ** 0.5 * [0.5, 0.4, 0.45] + [0.42, 0.5, 0.45]
    rgb = tint[i % 64, j % 64] * (1 - 0.45 * y / y.max())[..., None]
    rgb[border] = [0.9, 0.62, 0.2]
    rgb[lead & ~border] = 0.015
    # sRGB, as a glTF's colour textures are.
    code = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)
    Image.fromarray((code.clip(0, 1) * 255 + 0.5).astype(np.uint8)).save(path, optimize=True)
    return rgb.mean((0, 1))


def phong(kd, ks, n):
    return {"wrt": {"phong": {"kd": kd, "ks": ks, "n": n}}}


def room():
    m = Mesh()
    x, z, y = HALF, LENGTH / 2, HEIGHT
    m.polygon([(-x, 0, -z), (x, 0, -z), (x, y, -z), (-x, y, -z)])
    m.polygon([(x, 0, z), (-x, 0, z), (-x, y, z), (x, y, z)])
    m.polygon([(-x, 0, z), (-x, 0, -z), (-x, y, -z), (-x, y, z)])
    m.polygon([(x, 0, -z), (x, 0, z), (x, y, z), (x, y, -z)])
    m.polygon([(-x, y, -z), (x, y, -z), (x, y, z), (-x, y, z)])
    return m


def trim(places):
    """Sills below the windows, and beams under the ceiling."""
    m = Mesh()
    for side, z in places:
        lo, hi = sorted((side * HALF, side * (HALF - 0.09)))
        m.box((lo, SILL - 0.08, z - WIDE / 2 - 0.06), (hi, SILL - 0.02, z + WIDE / 2 + 0.06))
    for z in np.arange(-2.5, 2.6, 1.0):
        m.box((-HALF, HEIGHT - 0.18, z - 0.07), (HALF, HEIGHT, z + 0.07), skip="+y -x +x")
    return m


def build():
    print("window.png: mean linear RGB", window_picture(os.path.join(HERE, "window.png")).round(3))
    g = Gltf("hall")
    g.doc["scenes"][0]["extras"] = {"wrt": {"ambient": [0.05, 0.05, 0.055]}}

    def material(name, kd, ks, n, **more):
        rough = float(np.sqrt(np.sqrt(2 / (n + 2))))
        pbr = {"baseColorFactor": [*kd, 1.0], "metallicFactor": 0.0, "roughnessFactor": round(rough, 4)}
        return g.put("materials", {"name": name, "pbrMetallicRoughness": pbr, "extras": phong(kd, ks, n), **more})

    floor = material("polished_stone", [0.3, 0.27, 0.24], [0.4, 0.4, 0.4], 40)
    plaster = material("plaster", [0.7, 0.67, 0.6], [0.0, 0.0, 0.0], 4)
    oak = material("oak", [0.3, 0.2, 0.12], [0.05, 0.05, 0.05], 20)
    glow = g.texture("window.png")
    g.extension("KHR_materials_emissive_strength")
    glass = material("leaded_glass", [0.02, 0.02, 0.02], [0.0, 0.0, 0.0], 1, emissiveTexture={"index": glow},
                     emissiveFactor=[1.0, 1.0, 1.0],
                     extensions={"KHR_materials_emissive_strength": {"emissiveStrength": STRENGTH}})
    peak = digits([0, -np.sqrt(0.5), np.sqrt(0.5)])
    g.doc["materials"][glass]["extras"]["wrt"]["emission"] = {"exponent": 2, "peak": peak}

    tile = g.geometry(floor_rectangle(2, 2), textured=False)
    stone = g.mesh("tile", tile, floor)
    for row in range(3):
        for col in range(2):
            g.node(f"tile_{row}{col}", mesh=stone, translation=[2.0 * col - 1, 0.0, 2.0 * row - 2],
                   extras={"wrt": {"receiver": True}})

    pane = g.mesh("window", rectangle(WIDE, HIGH), glass)
    places = [(side, z) for side in (-1, 1) for z in np.arange(-2.5, 2.6, 1.0)]
    half = float(np.sqrt(0.5))
    for k, (side, z) in enumerate(places):
        # The mesh faces +Z; a quarter turn about Y makes it face into the room.
        g.node(f"window_{k:02}", mesh=pane, rotation=digits([0, -side * half, 0, half]),
               translation=digits([side * (HALF - 0.01), SILL + HIGH / 2, z], 5))
    g.node("room", mesh=g.mesh("room", room(), plaster))
    g.node("trim", mesh=g.mesh("trim", trim(places), oak))

    g.camera("along", (0.5, 1.6, 2.9), (-0.1, 0.75, -2.0), 60)
    g.camera("above", (0.0, 3.1, 1.2), (0.0, 0.0, -0.4), 75)
    g.save(os.path.join(HERE, "hall.gltf"), "hall.bin")
    print("hall.gltf:", len(g.doc["nodes"]), "nodes,", len(g.bin), "bytes of data")


if __name__ == "__main__":
    build()
