"""Triangle meshes in files: PLY, OBJ, STL, VTP and OFF.

Files hold (x, y, z), we hold (z, y, x). Swapping the axes is a reflection, so the
winding of the faces is reversed on the way in and on the way out; outside stays
outside. None of these formats holds a unit: lengths are µm.
"""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Surface, check_mesh_arrays
from ..errors import FileFormatError, InputError, MeshError
from ..geometry.mesh import face_normals, mesh_report
from ..geometry.repair import repair_mesh
from .atomic import replacing

logger = logging.getLogger(__name__)

Fields = dict[str, npt.NDArray[Any]]

MESH_SUFFIXES = (".ply", ".obj", ".stl", ".vtp", ".off")
FIELD_SUFFIXES = (".ply", ".vtp")
GEOMETRY_NAMES = {"x", "y", "z", "nx", "ny", "nz"}

# Compression can shrink equal numbers of 4 bytes a thousand times.
LARGEST_COUNT_PER_BYTE = 250

# What trimesh raises on files that are cut off or not what their name says.
PARSING_ERRORS = (
    ValueError,
    IndexError,
    KeyError,
    TypeError,
    AttributeError,
    EOFError,
    struct.error,
    NotImplementedError,
)


def read_mesh(path: str | Path, *, scale: float = 1.0, repaired: bool = True) -> Surface:
    """Read a triangle mesh, repair it, and report what was found.

    Parameters
    ----------
    path : path
        PLY, OBJ, STL, VTP or OFF, told apart by the suffix.
    scale : float
        µm per unit of the file, e.g. 1e-3 for a file in nm. The formats hold no unit.
    repaired : bool
        Make the mesh one closed manifold (:func:`~napari_unwrap3d.geometry.repair.repair`);
        False reads it as it is.

    Returns
    -------
    Surface
        Vertices (n, 3) zyx in µm, faces (m, 3), the fields of each vertex (PLY, VTP),
        and the report of the measures and repairs.

    Raises
    ------
    FileFormatError
        The file is damaged, truncated or of another kind.
    NotWatertightError, NotManifoldError, SeveralCellsError, MeshError
        The mesh cannot be repaired; see :func:`~napari_unwrap3d.geometry.repair.repair_mesh`.
    """
    path = Path(path)
    vertices, faces, fields = _load(path)
    if not np.isfinite(scale) or scale <= 0:
        raise InputError("The scale of a mesh is positive.", scale=scale)
    vertices = np.ascontiguousarray(vertices[:, ::-1], dtype=np.float64) * scale
    faces = np.ascontiguousarray(faces[:, ::-1], dtype=np.int64)
    try:
        check_mesh_arrays(vertices, faces)
    except MeshError as error:
        raise FileFormatError(f"{path.name}: {error}") from error
    if not repaired:
        report = {**mesh_report(vertices, faces), "file": path.name, "repairs": []}
        return Surface(vertices, faces, fields, report)
    result = repair_mesh(vertices, faces)
    kept = {name: values[result.origin] for name, values in fields.items()}
    return Surface(result.vertices, result.faces, kept, {**result.report, "file": path.name})


def write_mesh(
    path: str | Path,
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    fields: Mapping[str, npt.ArrayLike] | None = None,
) -> Path:
    """Write a triangle mesh; the format follows from the suffix.

    Parameters
    ----------
    path : path
        ``.ply`` (binary), ``.obj``, ``.stl`` (binary), ``.vtp`` or ``.off``.
    vertices : ndarray, (n, 3)
        (z, y, x) in µm; stored as float32 in PLY, STL and VTP.
    faces : ndarray, (m, 3)
    fields : mapping of str to ndarray, (n,) or (n, k), optional
        Values per vertex, kept by PLY and VTP: integers as int32, others as float32.
        The other formats cannot hold them, which is logged.

    Returns
    -------
    Path
        The file. It appears at once when complete, never half-written.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITERS:
        raise _unknown(path)
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    triangles = np.ascontiguousarray(faces, dtype=np.int64)
    check_mesh_arrays(points, triangles)
    checked = _checked_fields(fields or {}, len(points))
    if checked and path.suffix.lower() not in FIELD_SUFFIXES:
        logger.warning(
            "%s holds no fields: %s not written", path.suffix, ", ".join(sorted(checked))
        )
    with replacing(path) as partial:
        WRITERS[path.suffix.lower()](partial, points[:, ::-1], triangles[:, ::-1], checked)
    return path


def _unknown(path: Path) -> FileFormatError:
    return FileFormatError(
        f"{path.name} is not a kind of mesh that is known.",
        hint=f"Known: {', '.join(MESH_SUFFIXES)}.",
    )


def _checked_fields(fields: Mapping[str, npt.ArrayLike], n: int) -> Fields:
    """Fields as int32 or float32, one row per vertex."""
    result: Fields = {}
    for name, values in fields.items():
        array = np.asarray(values)
        if len(array) != n or array.ndim > 2:
            raise MeshError(
                f"The field {name!r} has the wrong shape.", shape=array.shape, vertices=n
            )
        result[name] = array.astype(np.int32 if array.dtype.kind in "biu" else np.float32)
    return result


# Reading ---------------------------------------------------------------------


def _load(path: Path) -> tuple[Floats, Ints, Fields]:
    """Vertices (x, y, z), faces and fields as they are in the file."""
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise _unknown(path)
    if not path.is_file():
        raise FileFormatError(f"There is no file {path}.", hint="Check the path.")
    if path.suffix.lower() == ".vtp":
        return _load_vtp(path)
    import trimesh

    try:
        mesh = trimesh.load_mesh(str(path), process=False, skip_materials=True)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        raw = mesh.metadata.get("_ply_raw", {})
        fields = _ply_fields(raw.get("vertex", {}), len(vertices))
        promised = _promised_faces(path, raw)
    except PARSING_ERRORS as error:
        raise _damaged(path, str(error)) from error
    if len(vertices) == 0 or len(faces) == 0:
        raise _damaged(path, "no triangles were found")
    if len(faces) < promised:
        raise _damaged(path, f"{len(faces)} faces of {promised} were found")
    return vertices, faces, fields


def _damaged(path: Path, why: str) -> FileFormatError:
    return FileFormatError(
        f"{path.name} cannot be read as a {path.suffix[1:].upper()} mesh: {why}.",
        bytes=path.stat().st_size,
        hint="The file may be truncated, or not a mesh; copy or export it again.",
    )


def _ply_fields(element: Mapping[str, Any], n: int) -> Fields:
    data = element.get("data", {})
    fields: Fields = {}
    for name in element.get("properties", {}):
        values = np.asarray(data[name])
        if name not in GEOMETRY_NAMES and values.size == n:
            fields[name] = np.ascontiguousarray(values.reshape(n))
    return fields


def _promised_faces(path: Path, ply: Mapping[str, Any]) -> int:
    """The number of faces that the header announces; 0 where there is none."""
    if path.suffix.lower() == ".ply":
        return int(ply.get("face", {}).get("length", 0))
    if path.suffix.lower() == ".off":
        text = re.sub(r"#.*", "", path.read_text(encoding="utf-8", errors="replace"))
        counts = re.findall(r"\d+", text.split("OFF", 1)[-1][:1000])
        return int(counts[1]) if len(counts) > 1 else 0
    return 0


def _load_vtp(path: Path) -> tuple[Floats, Ints, Fields]:
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    _check_vtp_counts(path)
    # VTK does not raise: it prints its errors, here into a string and not to the terminal.
    window, printed = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(printed)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader = vtkXMLPolyDataReader()
        reader.SetFileName(str(path))
        triangles = vtkTriangleFilter()
        triangles.PassLinesOff()
        triangles.PassVertsOff()
        triangles.SetInputConnection(reader.GetOutputPort())
        triangles.Update()
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(window)
    mesh = triangles.GetOutput()
    problem = re.search(r"\): (.+)", printed.GetOutput())
    if problem or mesh.GetNumberOfPolys() == 0:
        raise _damaged(path, problem[1].rstrip(".") if problem else "no triangles were found")
    to_numpy: Any = numpy_support.vtk_to_numpy  # declares no types
    vertices = to_numpy(mesh.GetPoints().GetData())
    faces = to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    data = mesh.GetPointData()
    arrays = [data.GetArray(i) for i in range(data.GetNumberOfArrays())]
    fields = {
        array.GetName(): np.array(to_numpy(array))
        for array in arrays
        if array is not None and array is not data.GetNormals()
    }
    return vertices, faces, fields


def _check_vtp_counts(path: Path) -> None:
    """Raise where a count is beyond what the file can hold: VTK would end the process."""
    header = path.read_bytes().split(b"<AppendedData", 1)[0]
    largest = max(map(int, re.findall(rb'NumberOf[A-Za-z]+="(\d+)"', header)), default=0)
    if largest > LARGEST_COUNT_PER_BYTE * path.stat().st_size:
        raise _damaged(path, f"it declares {largest} points or faces")


# Writing: points (x, y, z) and faces wound for them ---------------------------


def _write_ply(path: Path, points: Floats, faces: Ints, fields: Fields) -> None:
    columns: list[tuple[str, npt.NDArray[Any]]] = [
        (axis, points[:, i].astype(np.float32)) for i, axis in enumerate("xyz")
    ]
    for name, values in fields.items():
        word = re.sub(r"\s+", "_", name.strip())
        if values.ndim == 1:
            columns.append((word, values))
        else:
            columns += [(f"{word}_{i}", column) for i, column in enumerate(values.T)]
    record = np.empty(len(points), dtype=[(name, f"<{v.dtype.str[1:]}") for name, v in columns])
    for name, values in columns:
        record[name] = values
    corners = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    corners["count"], corners["corners"] = 3, faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment x, y, z in micrometres",
        f"element vertex {len(points)}",
        *(f"property {'int' if v.dtype.kind == 'i' else 'float'} {name}" for name, v in columns),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    with path.open("wb") as file:
        file.write("\n".join(header).encode("ascii", "replace"))
        file.write(record.tobytes())
        file.write(corners.tobytes())


def _write_obj(path: Path, points: Floats, faces: Ints, fields: Fields) -> None:
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write("# x, y, z in micrometres\n")
        np.savetxt(file, points, fmt="v %.9g %.9g %.9g")
        np.savetxt(file, faces + 1, fmt="f %d %d %d")


def _write_off(path: Path, points: Floats, faces: Ints, fields: Fields) -> None:
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"OFF\n{len(points)} {len(faces)} 0\n")
        np.savetxt(file, points, fmt="%.9g")
        np.savetxt(file, faces, fmt="3 %d %d %d")


def _write_stl(path: Path, points: Floats, faces: Ints, fields: Fields) -> None:
    record = np.zeros(
        len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    )
    record["normal"] = face_normals(points, faces)
    record["corners"] = points[faces]
    with path.open("wb") as file:
        file.write(b"x, y, z in micrometres".ljust(80))
        file.write(struct.pack("<I", len(faces)))
        file.write(record.tobytes())


def _write_vtp(path: Path, points: Floats, faces: Ints, fields: Fields) -> None:
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    to_vtk: Any = numpy_support.numpy_to_vtk  # declares no types
    to_index: Any = numpy_support.numpy_to_vtkIdTypeArray
    place = vtkPoints()
    place.SetData(to_vtk(np.ascontiguousarray(points, dtype=np.float32), deep=True))
    polygons = vtkCellArray()
    corners = np.ascontiguousarray(faces, dtype=np.int64).ravel()
    polygons.SetData(3, to_index(corners, deep=True))
    mesh = vtkPolyData()
    mesh.SetPoints(place)
    mesh.SetPolys(polygons)
    for name, values in fields.items():
        array = to_vtk(np.ascontiguousarray(values), deep=True)
        array.SetName(name)
        mesh.GetPointData().AddArray(array)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(mesh)
    if not writer.Write():
        raise OSError(f"{path.name} could not be written")


WRITERS: dict[str, Callable[[Path, Floats, Ints, Fields], None]] = {
    ".ply": _write_ply,
    ".obj": _write_obj,
    ".stl": _write_stl,
    ".vtp": _write_vtp,
    ".off": _write_off,
}
