#!/usr/bin/env python3
"""Rays per second of `tracer report rays` beside Embree's, same mesh, same rays.

    pip install embreex numpy
    tests/embree_rays.py PROGRAM [--triangles N...] [--rounds N]

The two take turns, so that both see the same machine, and CPU time is counted, so
that other work on it hardly matters; the median over the rounds is printed. embreex
calls Embree 2 or 3 by packets of eight rays, on one thread.
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--triangles", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    print("| triangles | rays | tracer | two threads | Embree | ratio | hits that differ |")
    print("|---|---|---|---|---|---|---|")
    for triangles in args.triangles:
        ours, both, theirs, hits = {}, {}, {}, {}
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            command = [args.program, "report", "rays", "--triangles", str(triangles), "--repeats", "3"]
            for _ in range(args.rounds):
                run = lambda *more: json.loads(subprocess.check_output([*command, *more]))
                one, two, other = run("--dump", name), run("--threads", "2"), embree(folder)
                for rays in ("primary", "diffuse"):
                    ours.setdefault(rays, []).append(one[rays]["mrays_per_cpu_second"])
                    both.setdefault(rays, []).append(two[rays]["mrays_per_second"])
                    theirs.setdefault(rays, []).append(other[rays][1])
                    hits[rays] = (one[rays]["rays"], abs(one[rays]["hits"] - other[rays][0]))
        for rays in ("primary", "diffuse"):
            a, b, c = (statistics.median(x[rays]) for x in (ours, both, theirs))
            count, differ = hits[rays]
            print(
                f"| {one['triangles']} | {count} {rays} | {a:.2f} | {b:.2f} | {c:.2f} | {a / c:.2f} | {differ} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
