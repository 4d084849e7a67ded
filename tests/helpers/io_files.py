"""Small files of every format, made byte by byte, and colors by hand."""

import struct

import numpy as np
import tolerances as tol

from splatcl.scene.splats import Splats

PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
XYZ_ROWS = "0 0 0\n1 0 0\n0 1 0\n"
PCD = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {0}\nHEIGHT 1\n"
PCD += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA ascii\n" + XYZ_ROWS
PTX = "1\n{}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 0 0 0.5\n0 1 0 0.5\n"
RAW = struct.pack("<I9f", 3, *range(9)) + struct.pack("<4I", 1, 0, 1, 2)
SOLID = "solid\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\nendsolid\n"
STL = b"binary".ljust(80) + struct.pack("<I12fH", 1, *range(12), 0)


LINEAR = {0: 0.0, 10: 0.0030353, 128: 0.2158605, 188: 0.5028865, 255: 1.0}
"""Linear values of 8-bit sRGB, by hand: x / 255 / 12.92 for 10, ((x / 255 + 0.055) / 1.055)^2.4 above."""

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5], [2, 0, 0.25]])
NORMALS = np.array([[0, 0, 1], [0, 0.6, 0.8], [0.6, 0, 0.8], [0, 0, -1], [1, 0, 0]])
BYTES = np.array([[0, 10, 128], [188, 255, 0], [128, 128, 128], [255, 0, 10], [10, 188, 255]])
FACES = [[0, 1, 2], [1, 3, 2], [1, 4, 3]]


def linear(values):
    return np.vectorize(LINEAR.get)(values)


def close(color, expected):
    np.testing.assert_allclose(color, expected, atol=tol.COLOR_ABSOLUTE)


def put(path, data):
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def ply(form, elements, newline="\n", comments=()):
    """Return a PLY file of elements (name, [(type, property)], rows); "list uchar int" is the type of a list."""
    codes = {
        "char": "b",
        "uchar": "B",
        "short": "h",
        "ushort": "H",
        "int": "i",
        "uint": "I",
        "float": "f",
        "double": "d",
    }
    head = ["ply", f"format {form} 1.0", *[f"comment {c}" for c in comments]]
    body = b""
    for name, properties, rows in elements:
        head += [f"element {name} {len(rows)}", *[f"property {kind} {prop}" for kind, prop in properties]]
        for row in rows:
            words = []
            for (kind, _), value in zip(properties, row, strict=True):
                parts = kind.split()
                if parts[0] == "list":
                    words += [(codes[parts[1]], len(value)), *[(codes[parts[2]], v) for v in value]]
                else:
                    words.append((codes[kind], value))
            if form == "ascii":
                body += (" ".join(repr(v) for _, v in words) + newline).encode()
            else:
                order = "<" if "little" in form else ">"
                body += b"".join(struct.pack(order + c, v) for c, v in words)
    return newline.join([*head, "end_header", ""]).encode() + body


def xyz(kind="float"):
    return [(kind, name) for name in "xyz"]


def rows(*arrays):
    return [[v.item() for part in row for v in part] for row in zip(*map(np.asarray, arrays), strict=True)]


def gaussian(num_axes, **values):
    names = [*"xyz", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0", "opacity"]
    names += [f"scale_{i}" for i in range(num_axes)] + [f"rot_{i}" for i in range(4)]
    row = [values.get(name, 0.0) for name in names]
    return ply("binary_little_endian", [("vertex", [("float", n) for n in names], [row])])


OBJ = "".join(f"v {p[0]} {p[1]} {p[2]}\n" for p in POINTS)


def native(dtype=np.float64, oriented=True, num=50):
    rng = np.random.default_rng(9)
    arrays = [rng.normal(size=(num, 3)).astype(dtype) for _ in range(3)]
    color = rng.random((num, 3)).astype(np.float32)
    return Splats(*arrays, color, oriented=oriented, num_dropped=3, notes=('gemacht für "splatcl"\nzwei',))


def one_splat():
    return Splats(np.zeros((1, 3)), np.eye(3)[:1], np.eye(3)[1:2])
