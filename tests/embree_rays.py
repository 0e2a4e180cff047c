#!/usr/bin/env python3
"""Rays per second of `tracer report rays` beside Embree's, same mesh, same rays.

    pip install embreex numpy            (and mitsuba, which needs libLLVM)
    tests/embree_rays.py PROGRAM [--triangles N...] [--rounds N] [--mitsuba]

The two take turns, so that both see the same machine, and CPU time is counted, so
that other work on it hardly matters; the median over the rounds is printed. This program
takes 32 rays at a time, primary ones as a fan and diffuse ones side by side, as it does
with a picture's camera rays and with those from mirrors and glass. embreex calls
Embree's rtcIntersect1, one ray after another; Mitsuba hands it packets as wide as the
processor's registers, told which are coherent. All find which triangle is met and
where; none is asked for more.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

import numpy
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh


def embree(folder):
    """Hits and Mrays per CPU second of each set of rays in `folder`."""
    read = lambda name, kind: numpy.fromfile(folder / name, kind).reshape(-1, 3)
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, read("positions.f32", "<f4"), read("triangles.u32", "<u4").astype("i4"))
    results = {}
    for name in ("primary", "diffuse"):
        rays = read(f"{name}.f32", "<f4").reshape(-1, 2, 3)
        origins, directions = (numpy.ascontiguousarray(rays[:, i]) for i in (0, 1))
        scene.run(origins[:1000], directions[:1000])
        start = time.process_time()
        hit = scene.run(origins, directions, query="INTERSECT")
        seconds = time.process_time() - start
        results[name] = (int((hit >= 0).sum()), len(rays) / 1e6 / seconds)
    return results


def mitsuba(folder):
    """As `embree`, by Mitsuba."""
    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    drjit.set_thread_count(0)  # the calling one
    read = lambda name, kind: numpy.fromfile(folder / name, kind)
    positions, triangles = read("positions.f32", "<f4"), read("triangles.u32", "<u4")
    mesh = mi.Mesh("mesh", len(positions) // 3, len(triangles) // 3)
    fields = mi.traverse(mesh)
    fields["vertex_positions"], fields["faces"] = mi.Float(positions), mi.UInt32(triangles)
    fields.update()
    scene = mi.load_dict({"type": "scene", "mesh": mesh})
    results = {}
    for name in ("primary", "diffuse"):
        rays = read(f"{name}.f32", "<f4").reshape(-1, 6).T
        origins, directions = (numpy.ascontiguousarray(rays[i : i + 3]) for i in (0, 3))
        ray = mi.Ray3f(mi.Point3f(origins), mi.Vector3f(directions))
        drjit.eval(ray)
        drjit.sync_thread()
        seconds = []
        for _ in range(4):  # the first compiles
            start = time.process_time()
            hit = scene.ray_intersect_preliminary(ray, coherent=name == "primary")
            drjit.eval(hit.t, hit.prim_index)
            drjit.sync_thread()
            seconds.append(time.process_time() - start)
        hits = int(numpy.isfinite(hit.t.numpy()).sum())
        results[name] = (hits, rays.shape[1] / 1e6 / statistics.median(seconds[1:]))
    return results


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--triangles", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--mitsuba", action="store_true", help="measure Embree by Mitsuba, too")
    args = parser.parse_args()
    others = {"Embree": embree, "by Mitsuba": mitsuba} if args.mitsuba else {"Embree": embree}
    heads = "".join(f" {name} | ratio | hits that differ |" for name in others)
    print(f"| triangles | rays | tracer | two threads |{heads}")
    print("|---|---|---|---|" + "---|---|---|" * len(others))
    for triangles in args.triangles:
        ours, both, theirs = {}, {}, {}
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            command = [args.program, "report", "rays", "--triangles", str(triangles), "--repeats", "3"]
            for _ in range(args.rounds):
                run = lambda *more: json.loads(subprocess.check_output([*command, *more]))
                one, two = run("--dump", name), run("--threads", "2")
                found = {other: measure(folder) for other, measure in others.items()}
                for rays in ("primary", "diffuse"):
                    ours.setdefault(rays, []).append(one[rays]["mrays_per_cpu_second"])
                    both.setdefault(rays, []).append(two[rays]["mrays_per_second"])
                    for other in others:
                        theirs.setdefault((rays, other), []).append(found[other][rays][1])
        for rays in ("primary", "diffuse"):
            a, b = (statistics.median(x[rays]) for x in (ours, both))
            line = f"| {one['triangles']} | {one[rays]['rays']} {rays} | {a:.2f} | {b:.2f} |"
            for other in others:
                c = statistics.median(theirs[rays, other])
                differ = abs(one[rays]["hits"] - found[other][rays][0])
                line += f" {c:.2f} | {a / c:.2f} | {differ} |"
            print(line, flush=True)


if __name__ == "__main__":
    main()
