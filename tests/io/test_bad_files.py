"""Bad files give one clear line: it begins with the path, names the place, and is never another library's error."""

import struct
import sys

import numpy as np
import pytest
from helpers.io_files import FACE, PCD, PLY, PTX, RAW, SOLID, STL, XYZ_ROWS, one_splat

import splatcl
from splatcl.errors import FileError, InvalidSplatsError, SettingsError
from splatcl.io.inspect import inspect

BAD = [
    ("a.ply", b"", "is empty"),
    ("a.xyz", b"", "is empty"),
    ("a.e57", b"ASTM-E57", "unknown file type .e57; it must be one of "),
    ("a", b"hello", "unknown file type without an extension"),
    # PLY
    ("a.ply", b"hello", "the PLY header has no end_header line"),
    ("a.ply", PLY[:60], "the PLY header has no end_header line"),
    ("a.ply", PLY + "end_header\n" + XYZ_ROWS[:12], "element 'vertex': row 2: early end-of-file"),
    ("a.ply", PLY + "end_header\n" + "0 0 0\n1 zero 0\n0 1 0\n", "element 'vertex': row 1: property 'y': malformed"),
    ("a.ply", PLY.replace("vertex 3", "vertex 99999999999") + "end_header\n", "line 3 announces 99999999999 rows"),
    ("a.ply", PLY.replace("vertex 3", "vertex -3") + "end_header\n", "line 3 announces -3 rows of element vertex;"),
    ("a.ply", PLY + "end_header\n" + XYZ_ROWS + "1 1 0\n", "line 11 follows the last of the 3 rows"),
    ("a.ply", PLY + FACE + XYZ_ROWS + "3 0 1 2\n\n3 1 2 0\n", "line 15 follows the last of the 4 rows"),
    ("a.ply", PLY.replace("\n", "\r\n") + "end_header\r\n" + XYZ_ROWS + "x\n", "line 11 follows the last of the 3"),
    ("a.ply", PLY.replace("vertex 3", "vertex 0") + "end_header\n", "has no points"),
    ("a.ply", PLY.replace("float z", "float w") + "end_header\n" + XYZ_ROWS, "has no element with properties x y z"),
    ("a.ply", PLY.replace("float z", "quad z") + "end_header\n" + XYZ_ROWS, "not a readable PLY file"),
    ("a.ply", PLY.replace("ascii", "binary_little_endian") + "end_header\n" + "x" * 30, "row 2: early end-of-file"),
    ("a.ply", PLY + FACE + XYZ_ROWS + "3 0 1 3\n", "face 0 refers to vertices 0, 1, 3; indices must be 0 to 2"),
    ("a.ply", PLY + FACE + XYZ_ROWS + "3 0 1 -1\n", "face 0 refers to vertices 0, 1, -1"),
    ("a.ply", PLY + FACE + XYZ_ROWS + "3 0 1\n", "element 'face': row 0"),
    ("a.ply", PLY + FACE.replace("vertex_indices", "corners") + XYZ_ROWS + "3 0 1 2\n", "no list vertex_indices"),
    # text
    ("a.xyz", "0 0 0\n1 one 0\n", "line 2: 'one' must be a number"),
    ("a.xyz", "0 0 0\n1 0\n", "line 2 has 2 numbers; a point must have x y z"),
    ("a.xyz", "# c\n0 0 0\n\n1 0 0 0\n", "line 4 has 4 numbers but the lines before have 3"),
    ("a.xyz", "0 0 0 0 0\n", "5 numbers per line"),
    ("a.xyz", "# nothing\n", "has no points"),
    ("a.xyz", b"0 0 0\n\0\n", "byte 6 is zero"),
    ("a.csv", "x,y,z,nx\n0,0,0\n", "4 columns are named but line 2 has 3 numbers"),
    ("a.pts", "5\n" + XYZ_ROWS, "line 1 announces 5 points but 3 follow"),
    ("a.pts", "# c\n2\n" + XYZ_ROWS, "line 2 announces 2 points but 3 follow"),
    ("a.ptx", PTX.format(3), "line 1 announces 3 points but 2 lines follow line 10"),
    ("a.ptx", PTX.format("two"), "line 1 does not begin a PTX scan"),
    ("a.ptx", PTX.format(2) + "junk\n", "line 13 does not begin a PTX scan"),
    ("a.ptx", PTX.format(2).replace("0 1 0 0.5", "0 1 O 0.5"), "line 12: 'O' must be a number"),
    # PCD
    ("a.pcd", PCD.format(4), "POINTS 4, but 3 points; the header is wrong"),
    ("a.pcd", PCD.format(99999), "POINTS is 99999, but the file has only"),
    ("a.pcd", PCD.format(3).replace("x y z", "x y w"), "has no field z; its FIELDS are x y w"),
    ("a.pcd", PCD.format(3).replace("1 0 0\n0", "1 o 0\n0"), "not a readable PCD file"),
    ("a.pcd", "garbage", "not a readable PCD file"),
    # OBJ, OFF, STL, GLB, RAW
    ("a.obj", "v 0 0 0\nv 1 o 0\n", "line 2: 'o' must be a number"),
    ("a.obj", "v 0 0 0\nv 1 0\n", "line 2: 'v' has 2 numbers"),
    ("a.obj", "v 0 0 0\nf 1 2 3\n", "face 0 refers to vertices 0, 1, 2; indices must be 0 to 0"),
    ("a.obj", "v 0 0 0\nf 0 1 1\n", "line 2 refers to a vertex before the first"),
    ("a.obj", "v 0 0 0\nf -2 1 1\n", "line 2 refers to a vertex before the first"),
    ("a.obj", "v 0 0 0\nf a b c\n", "line 2: 'a' must be an integer"),
    ("a.obj", "v 0 0 0\nv 1 0 0 1 1 1\n", "some vertices have no color; give all"),
    ("a.obj", "hello\n", "has no points"),
    ("a.off", "5 3 0\n" + XYZ_ROWS, "begins with '5'; it must begin with one of OFF"),
    ("a.off", "OFF\n", "line 1 must hold the numbers of vertices"),
    ("a.off", "OFF\n3 many 0\n" + XYZ_ROWS, "line 2 must hold the numbers of vertices"),
    ("a.off", "OFF\n3 1 0\n" + XYZ_ROWS, "announces 3 vertices and 1 faces but 3 lines follow"),
    ("a.off", "OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 4 has 2 numbers"),
    ("a.off", "OFF\n3 1 0\n" + XYZ_ROWS + "4 0 1 2\n", "line 6 announces a face of 4 corners but has 3"),
    ("a.off", "OFF\n3 1 0\n" + XYZ_ROWS + "3 0 1 7\n", "face 0 refers to vertices 0, 1, 7"),
    ("a.stl", STL[:-1], "byte 80 announces 1 triangles, which take 134 bytes, but the file has 133"),
    ("a.stl", SOLID + SOLID[:30], "has 4 vertex lines but 1 whole triangles"),
    ("a.glb", b"glTF" + bytes(30), "not a readable GLB file"),
    ("a.raw", RAW[:-1], "byte 40 announces 1 faces, but the file ends at byte 55"),
    ("a.raw", RAW + b"x", "1 bytes follow its faces at byte 56"),
    ("a.raw", RAW[:-4] + b"\3\0\0\0", "face 0 refers to vertices 0, 1, 3"),
    ("a.raw", b"\xff\xff\xff\xff", "byte 0 announces 4294967295 vertices"),
    # LAS, NPZ
    ("a.las", b"LASF", "has no LAS header"),
    ("a.laz", b"hello" * 100, "has no LAS header"),
    ("a.npz", b"PK\3\4 and so on", "not a readable NPZ file"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "data", "message"), BAD)
def test_bad_file_is_one_line_that_names_path_and_place(tmp_path, name, data, message):
    path = tmp_path / name
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    with pytest.raises(FileError) as caught:
        splatcl.read(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert message in text
    assert "\n" not in text
    with pytest.raises(FileError):
        inspect(path)


def test_blank_lines_may_follow_the_rows_of_a_ply(tmp_path):
    (tmp_path / "a.ply").write_text(PLY + "end_header\n" + XYZ_ROWS + "\n  \n\r\n")
    assert len(splatcl.read(tmp_path / "a.ply")) == 3


def test_missing_file_and_directory(tmp_path):
    with pytest.raises(FileError, match=r"none\.ply: cannot read: No such file"):
        splatcl.read(tmp_path / "none.ply")
    with pytest.raises(FileError, match="is a folder; give a file in it"):
        splatcl.read(tmp_path)


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e400", "1e16"])
@pytest.mark.parametrize("name", ["a.xyz", "a.obj", "a.off"])
def test_unusable_coordinates_are_counted_or_dropped(tmp_path, name, number):
    lines = ["0 0 0", f"1 {number} 0", "0 1 0", "1 1 0"]
    text = {"a.xyz": "{}\n", "a.obj": "v {}\n", "a.off": "{}\n"}[name]
    head = "OFF 4 0 0\n" if name == "a.off" else ""
    path = tmp_path / name
    path.write_text(head + "".join(text.format(line) for line in lines))
    with pytest.raises(InvalidSplatsError) as caught:
        splatcl.read(path)
    assert str(caught.value).startswith(f"{path}: 1 of 4 points (1 with a ")
    assert "the first is point 1); drop them with on_invalid='drop'" in str(caught.value)
    splats = splatcl.read(path, on_invalid="drop")
    assert (len(splats), splats.num_dropped) == (3, 1)
    assert any(note.startswith("dropped 1 of 4 points") for note in splats.notes)


def test_mesh_with_unusable_corners(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan inf -Inf\nf 1 2 3\nf 2 4 3\n")
    with pytest.raises(InvalidSplatsError, match=r"a\.obj: 1 of 2 triangles .* face 1"):
        splatcl.read(path)
    assert splatcl.read(path, on_invalid="drop").num_dropped == 1
    assert inspect(path).skipped == ((1, "triangles with a non-finite or huge number"),)


def test_all_unusable_is_an_error_even_when_dropping(tmp_path):
    (tmp_path / "a.xyz").write_text("nan 0 0\n")
    with pytest.raises(InvalidSplatsError, match="none of 1 points is usable"):
        splatcl.read(tmp_path / "a.xyz", on_invalid="drop")


def test_unknown_on_invalid(tmp_path):
    with pytest.raises(SettingsError, match="must be 'error' or 'drop'"):
        splatcl.read(tmp_path / "a.ply", on_invalid="ignore")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "module", "extra"), [("a.stl", "trimesh", "mesh"), ("a.las", "laspy", "las"), ("a.pcd", "pypcd4", "pcd")]
)
def test_missing_library_is_named_with_its_remedy(tmp_path, monkeypatch, name, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / name).write_bytes(STL)
    kind = name[2:].upper()
    with pytest.raises(FileError) as caught:
        splatcl.read(tmp_path / name)
    assert str(caught.value).endswith(f"cannot read {kind} without {module}; pip install 'splatcl[{extra}]'")


def test_glb_that_needs_an_unknown_extension(tmp_path):
    header = b'{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]} '
    data = b"glTF" + struct.pack("<III", 2, 20 + len(header), len(header)) + b"JSON" + header
    (tmp_path / "a.glb").write_bytes(data)
    with pytest.raises(FileError, match="needs the glTF extension KHR_draco_mesh_compression"):
        splatcl.read(tmp_path / "a.glb")


@pytest.mark.parametrize("name", ["a.obj", "a", "none/a.ply"])
def test_splats_are_not_written_elsewhere(tmp_path, name):
    with pytest.raises(FileError, match=r"\.ply or \.npz|does not exist"):
        splatcl.write(one_splat(), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    splatcl.write(one_splat(), path)
    before = path.read_bytes()

    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", fail)
    with pytest.raises(FileError, match=r"cannot write: No space left on device"):
        splatcl.write(one_splat(), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]


def test_damaged_native_files(tmp_path):
    np.savez(tmp_path / "a.npz", center=np.zeros((2, 3)))
    with pytest.raises(FileError, match=r"has no array tangent_u"):
        splatcl.read(tmp_path / "a.npz")
    arrays = {name: np.ones((2, 3)) for name in ("center", "tangent_u", "tangent_v", "color")}
    np.savez(tmp_path / "a.npz", **{**arrays, "color": np.ones((1, 3))})
    with pytest.raises(FileError, match="array color has 1 rows but center has 2"):
        splatcl.read(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InvalidSplatsError, match=r"2 of 2 splats .2 with"):
        splatcl.read(tmp_path / "a.npz")
    splatcl.write(one_splat(), tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes().replace(b'"oriented": true', b'"oriented":,true')
    (tmp_path / "a.ply").write_bytes(data)
    with pytest.raises(FileError, match="the splatcl comment in its header is damaged"):
        splatcl.read(tmp_path / "a.ply")
