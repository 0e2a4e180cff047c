"""Writes the two small scenes: quad (glTF and OBJ, no extras) and facing.

Run: `python3 scenes/plain.py` (numpy).
"""
import os
import numpy as np
from wrtgltf import Gltf, Mesh, floor_rectangle

HERE = os.path.dirname(os.path.abspath(__file__))

# quad: an upright emitter of 1 x 1 m looking along +Z over a floor of 2 x 2 m
EMITTER = [(-0.5, 0.25, -1.25), (0.5, 0.25, -1.25), (0.5, 1.25, -1.25), (-0.5, 1.25, -1.25)]
FLOOR = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
RADIANCE = [6.0, 5.0, 3.0]
BASE, ROUGHNESS = [0.5, 0.5, 0.55], 0.5
# the same by the mapping rules: kd = base * (1 - 0.04), n = 2 / 0.5^4 - 2
KD, KS, N = [0.48, 0.48, 0.528], [0.04, 0.04, 0.04], 30


def polygon(points):
    m = Mesh()
    m.polygon(points)
    return m


def emitter(g, factor, strength):
    """A black Lambertian emitter of radiance factor * strength."""
    g.extension("KHR_materials_emissive_strength")
    return g.put("materials", {
        "name": "emitter", "emissiveFactor": factor,
        "pbrMetallicRoughness": {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}})


def quad_gltf():
    g = Gltf("quad")
    light = emitter(g, [v / max(RADIANCE) for v in RADIANCE], max(RADIANCE))
    floor = g.put("materials", {"name": "floor", "pbrMetallicRoughness": {
        "baseColorFactor": [*BASE, 1.0], "metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}})
    g.node("emitter", mesh=g.mesh("emitter", polygon(EMITTER), light))
    g.node("floor", mesh=g.mesh("floor", polygon(FLOOR), floor))
    g.camera("camera", (1.6, 1.5, 2.8), (0, 0.35, -0.3), 45)
    g.save(os.path.join(HERE, "quad", "quad.gltf"))


def quad_obj():
    row = lambda key, v: f"{key} " + " ".join(f"{a:g}" for a in v) + "\n"
    with open(os.path.join(HERE, "quad", "quad.mtl"), "w", newline="\n") as f:
        f.write("# Emitter and floor of quad.obj\n")
        f.write("newmtl emitter\n" + row("Kd", [0, 0, 0]) + row("Ks", [0, 0, 0]) + row("Ke", RADIANCE))
        f.write("\nnewmtl floor\n" + row("Kd", KD) + row("Ks", KS) + f"Ns {N}\n")
    with open(os.path.join(HERE, "quad", "quad.obj"), "w", newline="\n") as f:
        f.write("# An upright emitter over a floor; metres, +Y up\nmtllib quad.mtl\n\n")
        for p in EMITTER + FLOOR:
            f.write(row("v", p))
        f.write("\nvn 0 0 1\nvn 0 1 0\n")
        f.write("\no emitter\nusemtl emitter\nf 1//1 2//1 3//1 4//1\n")
        f.write("\no floor\nusemtl floor\nf 5//2 6//2 7//2 8//2\n")


def facing():
    g = Gltf("facing")
    light = emitter(g, [1.0, 1.0, 1.0], 1.0)
    grey = g.put("materials", {
        "name": "receiver",
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
        "extras": {"wrt": {"phong": {"kd": [0.5, 0.5, 0.5], "ks": [0.0, 0.0, 0.0], "n": 1}}}})
    down = polygon([(-0.5, 1, -0.5), (0.5, 1, -0.5), (0.5, 1, 0.5), (-0.5, 1, 0.5)])
    g.node("emitter", mesh=g.mesh("emitter", down, light))
    g.node("receiver", mesh=g.mesh("receiver", floor_rectangle(1, 1), grey), extras={"wrt": {"receiver": True}})
    g.camera("camera", (1.2, 0.8, 1.8), (0, 0.3, 0), 45)
    g.save(os.path.join(HERE, "facing", "facing.gltf"))


if __name__ == "__main__":
    quad_gltf()
    quad_obj()
    facing()
