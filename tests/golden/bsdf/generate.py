"""Makes the BSDFs beside it, and prints what Radiance finds in them.

    pip install pyradiance==1.3.1   # ships Radiance's own programs
    python3 tests/golden/bsdf/generate.py
"""

import os
from pathlib import Path

import pyradiance as pr
import pyradiance.bsdf as sd
from pyradiance import genbsdf

HERE = Path(__file__).parent
os.environ.setdefault("RAYPATH", str(Path(pr.__file__).parent / "lib"))

BLIND = genbsdf.generate_blinds_for_bsdf(
    genbsdf.ShadingMaterial(0.6, 0.0, 0.0),
    genbsdf.BlindsGeometry(depth=0.05, width=0.5, height=0.5, nslats=10, angle=40),
)
HERE.joinpath("blind.rad").write_bytes(BLIND)
BOX = genbsdf.SamplingBox(-0.2, 0.2, -0.2, 0.2, -0.05, 0)


def write(name, wrapped, **options):
    scene = str(HERE / "blind.rad")
    found = genbsdf.generate_bsdf(scene, geout=False, nsamp=400, dim=BOX, front=True, **options)
    HERE.joinpath(name).write_bytes(genbsdf.generate_xml(vis_results=found, basis=wrapped))


write("blind_kq.xml", "kq", basis="kq")
write("blind_t4.xml", "t4", tensortree=4, ttlog2=3, pctcull=80)
write("blind_t3.xml", "t3", tensortree=3, ttlog2=3, pctcull=80)

for name in ["blind_kq.xml", "blind_t4.xml", "blind_t3.xml"]:
    data = sd.load_file(str(HERE / name))
    print(name)
    for theta, phi in [(0, 0), (20, 90), (40, 30), (40, 210), (60, 270), (60, 90)]:
        # 'to the light', outdoors (z < 0); transmitted, scattered.
        print("  hemi", theta, phi, sd.direct_hemi(data, theta, phi, sd.SAMPLE_ALL & ~sd.SAMPLE_R))
