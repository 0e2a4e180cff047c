"""Meshes and a small glTF 2.0 writer for the scene generators."""
import base64
import json
import os
import numpy as np


def unit(v):
    v = np.asarray(v, float)
    return v / np.linalg.norm(v)


class Mesh:
    """Triangles with positions, normals and texture coordinates."""

    def __init__(self):
        self.p, self.n, self.t, self.i = [], [], [], []

    def add(self, p, n, t, tri):
        at = len(self.p)
        self.p += [tuple(map(float, v)) for v in p]
        self.n += [tuple(map(float, v)) for v in n]
        self.t += [tuple(map(float, v)) for v in t]
        self.i += [at + k for f in tri for k in f]

    def polygon(self, pts, uv=None, scale=0.5):
        """A convex planar polygon, counter-clockwise seen from its front."""
        pts = np.asarray(pts, float)
        n = unit(sum(np.cross(pts[k] - pts[0], pts[k + 1] - pts[0]) for k in range(1, len(pts) - 1)))
        if uv is None:  # project along the main axis of the normal
            a = int(np.argmax(np.abs(n)))
            u, v = [(2, 1), (0, 2), (0, 1)][a]
            uv = np.stack([pts[:, u], -pts[:, v]], 1) * scale
        self.add(pts, [n] * len(pts), uv, [(0, k, k + 1) for k in range(1, len(pts) - 1)])

    def box(self, lo, hi, scale=0.5, skip=""):
        """An axis-aligned box; `skip` names faces left out, e.g. "-y"."""
        (a, b, c), (d, e, f) = lo, hi
        faces = {"-x": [(a, b, c), (a, b, f), (a, e, f), (a, e, c)],
                 "+x": [(d, b, f), (d, b, c), (d, e, c), (d, e, f)],
                 "-y": [(a, b, c), (d, b, c), (d, b, f), (a, b, f)],
                 "+y": [(a, e, f), (d, e, f), (d, e, c), (a, e, c)],
                 "-z": [(d, b, c), (a, b, c), (a, e, c), (d, e, c)],
                 "+z": [(a, b, f), (d, b, f), (d, e, f), (a, e, f)]}
        for name, pts in faces.items():
            if name not in skip.split():
                self.polygon(pts, scale=scale)

    def lathe(self, profile, sides=24, around=2.0, scale=0.5, crease=0.8):
        """Turns a profile of (radius, height), from bottom to top, about +Y.

        Edges of the profile sharper than `crease` radians stay sharp."""
        prof = np.asarray(profile, float)
        seg = np.diff(prof, axis=0)
        length = np.linalg.norm(seg, axis=1)
        out = np.stack([seg[:, 1], -seg[:, 0]], 1) / length[:, None]
        run = np.concatenate([[0], np.cumsum(length)])
        ang = np.linspace(0, 2 * np.pi, sides + 1)
        for k in range(len(seg)):
            ends = []
            for other in (k - 1, k + 1):
                n = out[k]
                if 0 <= other < len(seg) and out[k] @ out[other] > np.cos(crease):
                    n = unit(out[k] + out[other])
                ends.append(n)
            p, n, t = [], [], []
            for e in (0, 1):
                r, y = prof[k + e]
                for q, a in enumerate(ang):
                    s, c = np.sin(a), np.cos(a)
                    p.append((r * s, y, r * c))
                    n.append((ends[e][0] * s, ends[e][1], ends[e][0] * c))
                    t.append((around * q / sides, -run[k + e] * scale))
            m, tri = sides + 1, []
            for q in range(sides):
                if prof[k][0] > 1e-9:
                    tri.append((q, q + 1, m + q + 1))
                if prof[k + 1][0] > 1e-9:
                    tri.append((q, m + q + 1, m + q))
            self.add(p, n, t, tri)

    def strip(self, a, b, na, nb=None, scale=0.5):
        """A smooth strip between two rows of points; the given normals say
        which side is its front."""
        a, b = np.asarray(a, float), np.asarray(b, float)
        na = np.asarray(na, float)
        nb = na if nb is None else nb
        run = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(a, axis=0), axis=1))])
        w = np.linalg.norm(b - a, axis=1)
        t = [(r * scale, 0) for r in run] + [(r * scale, -h * scale) for r, h in zip(run, w)]
        m = len(a)
        tri = []
        for k in range(m - 1):
            for f in ((k, k + 1, m + k + 1), (k, m + k + 1, m + k)):
                q = [(a if j < m else b)[j % m] for j in f]
                face = np.cross(q[1] - q[0], q[2] - q[0])
                if np.linalg.norm(face) > 1e-9:
                    tri.append(f if face @ (na[k] + na[k + 1]) > 0 else f[::-1])
        self.add(list(a) + list(b), [unit(v) for v in na] + [unit(v) for v in nb], t, tri)

    def moved(self, by, turn=0.0):
        """A copy turned about +Y (radians), then translated."""
        c, s = np.cos(turn), np.sin(turn)
        m = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        out = Mesh()
        out.p = [tuple(m @ v + by) for v in np.array(self.p)]
        out.n = [tuple(m @ v) for v in np.array(self.n)]
        out.t, out.i = list(self.t), list(self.i)
        return out

    def join(self, *others):
        for o in others:
            at = len(self.p)
            self.p, self.n, self.t = self.p + o.p, self.n + o.n, self.t + o.t
            self.i += [at + k for k in o.i]
        return self


def rectangle(x, y):
    """x by y metres about the origin in the XY plane, facing +Z, v downwards."""
    m = Mesh()
    m.polygon([(-x / 2, -y / 2, 0), (x / 2, -y / 2, 0), (x / 2, y / 2, 0), (-x / 2, y / 2, 0)],
              [(0, 1), (1, 1), (1, 0), (0, 0)])
    return m


def floor_rectangle(x, z):
    """x by z metres about the origin in the XZ plane, facing +Y."""
    m = Mesh()
    m.polygon([(-x / 2, 0, z / 2), (x / 2, 0, z / 2), (x / 2, 0, -z / 2), (-x / 2, 0, -z / 2)],
              [(0, 1), (1, 1), (1, 0), (0, 0)])
    return m


def look_at(eye, target, up=(0, 1, 0)):
    """Quaternion (x, y, z, w) of a camera (looking along -Z) at `eye`."""
    z = unit(np.subtract(eye, target))
    x = unit(np.cross(up, z))
    y = np.cross(z, x)
    m = np.stack([x, y, z], 1)
    w = np.sqrt(max(0, 1 + m[0, 0] + m[1, 1] + m[2, 2])) / 2
    if w > 1e-4:
        q = [(m[2, 1] - m[1, 2]) / (4 * w), (m[0, 2] - m[2, 0]) / (4 * w), (m[1, 0] - m[0, 1]) / (4 * w), w]
    else:  # half a turn
        k = int(np.argmax(np.diag(m)))
        v = (m[:, k] + np.eye(3)[k]) / 2
        q = [*unit(v), 0]
    return unit(q)


def digits(v, n=7):
    return [round(float(a), n) + 0.0 for a in v]


class Gltf:
    def __init__(self, title):
        self.doc = {"asset": {"version": "2.0", "generator": "wrt scenes",
                              "copyright": "WRT developers, MIT OR Apache-2.0"},
                    "scene": 0, "scenes": [{"name": title, "nodes": []}]}
        self.bin = bytearray()

    def put(self, key, item):
        self.doc.setdefault(key, []).append(item)
        return len(self.doc[key]) - 1

    def extension(self, name):
        used = self.doc.setdefault("extensionsUsed", [])
        if name not in used:
            used.append(name)

    def data(self, array, kind, target=None, bounds=False):
        array = np.ascontiguousarray(array)
        view = {"buffer": 0, "byteOffset": len(self.bin), "byteLength": array.nbytes}
        if target:
            view["target"] = target
        self.bin += array.tobytes()
        self.bin += bytes(-len(self.bin) % 4)
        acc = {"bufferView": self.put("bufferViews", view),
               "componentType": {"float32": 5126, "uint16": 5123, "uint32": 5125}[str(array.dtype)],
               "count": len(array), "type": kind}
        if bounds:
            flat = array.reshape(len(array), -1)
            acc["min"], acc["max"] = flat.min(0).tolist(), flat.max(0).tolist()
        return self.put("accessors", acc)

    def geometry(self, mesh, textured=True):
        """Accessors of a mesh, to share between primitives."""
        small = len(mesh.p) < 65535
        n = np.array(mesh.n, np.float64)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        attributes = {"POSITION": self.data(np.array(mesh.p, np.float32), "VEC3", 34962, True),
                      "NORMAL": self.data(n.astype(np.float32), "VEC3", 34962)}
        if textured:
            attributes["TEXCOORD_0"] = self.data(np.array(mesh.t, np.float32), "VEC2", 34962)
        return (attributes,
                self.data(np.array(mesh.i, np.uint16 if small else np.uint32), "SCALAR", 34963))

    def mesh(self, name, geometry, material):
        if isinstance(geometry, Mesh):
            geometry = self.geometry(geometry, "Texture" in json.dumps(self.doc["materials"][material]))
        attributes, indices = geometry
        return self.put("meshes", {"name": name, "primitives": [
            {"attributes": attributes, "indices": indices, "material": material}]})

    def node(self, name, **fields):
        at = self.put("nodes", {"name": name, **fields})
        self.doc["scenes"][0]["nodes"].append(at)
        return at

    def texture(self, uri):
        if "samplers" not in self.doc:
            self.put("samplers", {"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497})
        return self.put("textures", {"sampler": 0, "source": self.put("images", {"uri": uri})})

    def camera(self, name, eye, target, yfov=50, aspect=4 / 3, up=(0, 1, 0)):
        cam = self.put("cameras", {"name": name, "type": "perspective", "perspective": {
            "yfov": round(np.radians(yfov), 6), "znear": 0.05, "zfar": 100.0, "aspectRatio": round(aspect, 6)}})
        return self.node(name, camera=cam, translation=digits(eye, 5), rotation=digits(look_at(eye, target, up)))

    def save(self, path, bin_name=None):
        """Writes the file; without `bin_name` the data is embedded in it."""
        buffer = {"byteLength": len(self.bin)}
        if bin_name:
            buffer["uri"] = bin_name
            with open(os.path.join(os.path.dirname(path), bin_name), "wb") as f:
                f.write(self.bin)
        else:
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.bin)).decode()
        self.doc["buffers"] = [buffer]
        with open(path, "w", newline="\n") as f:
            json.dump(self.doc, f, indent=1)
            f.write("\n")
