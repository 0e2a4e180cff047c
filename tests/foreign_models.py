#!/usr/bin/env python3
"""Renders every glTF, GLB and OBJ file below some folders, none of them ours.

    tests/foreign_models.py PROGRAM FOLDER... [--table FILE] [--limit SECONDS]

Each must end in a picture or in an error that says why, within the limit; a panic,
a signal, a hang or a picture without a pixel lit is a failure, and the exit code
says whether there was one. `tests/foreign_models.md` says where the models of its
table come from. Python 3.9 or later, nothing else.
"""

import argparse
import collections
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import time
import zlib

SIZE = "48x36"


def png_range(path):
    """Smallest and largest byte of an 8-bit PNG of ours, filters undone."""
    data = path.read_bytes()
    at, packed = 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        if kind == b"IHDR":
            width, height, _, colour = struct.unpack(">IIBB", data[at + 8 : at + 18])
        elif kind == b"IDAT":
            packed += data[at + 8 : at + 8 + length]
        at += 12 + length
    channels = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
    raw, stride = zlib.decompress(packed), width * channels
    above, low, high = bytearray(stride), 255, 0
    for y in range(height):
        kind = raw[y * (stride + 1)]
        row = bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for x in range(stride):
            a = row[x - channels] if x >= channels else 0
            b, c = above[x], above[x - channels] if x >= channels else 0
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[x] = (row[x] + (0, a, b, (a + b) // 2, nearest)[kind]) & 255
        low, high, above = min(low, *row), max(high, *row), row
    return low, high


def render(program, model, limit):
    """Result, seconds and remark of one model."""
    with tempfile.TemporaryDirectory() as folder:
        picture = pathlib.Path(folder, "a.png")
        command = [program, "render", str(model), "--size", SIZE, "--samples", "2", "--threads", "1"]
        start = time.monotonic()
        try:
            ran = subprocess.run(
                [*command, "-o", str(picture)], capture_output=True, timeout=limit, check=False
            )
        except subprocess.TimeoutExpired:
            return "HANG", limit, f"no end within {limit} s"
        seconds = time.monotonic() - start
        words = ran.stderr.decode(errors="replace").replace(str(model), model.name)
        words = words.replace(str(model.parent), "…").replace("tracer: ", "")
        lines = [line for line in words.splitlines() if line.strip()]
        warnings = [l.split(": ", 2)[-1] for l in lines if l.startswith("warning: ")]
        if ran.returncode == 0:
            low, high = png_range(picture)
            if low == high:
                return "blank", seconds, "; ".join(warnings)
            return "picture", seconds, "; ".join(warnings)
        last = lines[-1] if lines else ""
        if ran.returncode != 1 or "panicked" in words or not last:
            return "CRASH", seconds, f"exit code {ran.returncode}: {last}"
        return "error", seconds, last


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("folders", nargs="+", type=pathlib.Path)
    parser.add_argument("--table", type=pathlib.Path, help="write the results as Markdown")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds for each model")
    args = parser.parse_args()

    rows, counts = [], collections.Counter()
    for folder in args.folders:
        models = (p for p in folder.rglob("*") if p.suffix.lower() in (".gltf", ".glb", ".obj"))
        for model in sorted(models):
            result, seconds, remark = render(args.program, model, args.limit)
            counts[result] += 1
            name = f"{folder.name}/{model.relative_to(folder)}"
            remark = re.sub(r"\s+", " ", remark).replace("|", "\\|")
            print(f"{result:8} {seconds:6.2f} s  {name}  {remark}", flush=True)
            rows.append((name, result, remark))
    summary = ", ".join(f"{n} {result}" for result, n in counts.most_common())
    print(f"{len(rows)} models: {summary}")
    if args.table:
        head = f"{len(rows)} models: {summary}.\n\n| model | result | warnings, or the error |\n|---|---|---|\n"
        args.table.write_text(head + "".join(f"| {n} | {r} | {m} |\n" for n, r, m in rows))
    return 1 if counts["CRASH"] + counts["HANG"] else 0



if __name__ == "__main__":
    sys.exit(main())
