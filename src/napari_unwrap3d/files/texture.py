"""Meshes with a uv image as their texture: OBJ, its material (MTL) and the image (PNG).

Texture coordinates count from the lower left corner, images from the upper left, and pixel
centres lie at integers: ``s = (u + ½) / 2N`` and ``t = 1 − (v + ½) / N``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, check_mesh_arrays
from ..errors import AxesError, InputError, MeshError
from ..unwrapping.surface import same_mesh
from ..unwrapping.uv import direction_to_uv
from .atomic import replacing
from .drawing import curvature_colours, sequential

if TYPE_CHECKING:
    from ..atlas import Atlas

MATERIAL = "unwrapped"
WITHOUT_IMAGE = "without_image"
AT_POLE = 1e-6

# Fields of the uv chart that can be a texture, the first one that is there.
SURFACE_FIELDS = ("surface_mean_curvature_per_um", "surface_height_um")
DIRECT_FIELD = "mean_curvature_per_um"
REFERENCE_FIELDS = ("mean_curvature_per_um", "area_distortion")


def write_textured_mesh(
    path: str | Path,
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    vu: npt.ArrayLike,
    image: npt.ArrayLike,
) -> Path:
    """Write an OBJ whose texture is a uv image; the MTL and the PNG are written beside it.

    The mesh stays as it is, also closed: only the texture coordinates are cut at the seam.

    Parameters
    ----------
    path : path
        Ends in ``.obj``. The material and the image have its name with ``.mtl`` and
        ``.png`` (spaces become underscores, as OBJ readers split at them).
    vertices : ndarray, (n, 3)
        (z, y, x) in µm.
    faces : ndarray, (m, 3)
    vu : ndarray, (n, 2)
        (v, u) in pixels per vertex; NaN where a vertex has no image. Faces with such a
        corner are grey.
    image : ndarray, (N, 2N, 3) or (N, 2N) uint8
        Colours, or shades of grey.

    Returns
    -------
    Path
        The OBJ. It appears when everything is complete.

    Raises
    ------
    AxesError, InputError
        The image is no uint8 image of N × 2N pixels.
    MeshError
        The arrays do not fit together.
    """
    path = Path(path)
    if path.suffix.lower() != ".obj":
        raise InputError(f"{path.name!r} cannot have a texture.", hint="Use .obj.")
    pixels = _checked_image(np.asarray(image))
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    triangles = np.ascontiguousarray(faces, dtype=np.int64)
    check_mesh_arrays(points, triangles)
    where = np.asarray(vu, dtype=np.float64)
    if where.shape != (len(points), 2):
        raise MeshError("There is one (v, u) per vertex.", shape=where.shape, vertices=len(points))
    corners = texture_corners(where, triangles, len(pixels))
    stem = re.sub(r"\s+", "_", path.stem)
    with replacing(path) as partial:
        _write_image(partial.with_name(f"{stem}.png"), pixels)
        _write_material(partial.with_name(f"{stem}.mtl"), f"{stem}.png")
        # Axes and winding are turned as in every other mesh file.
        mesh = points[:, ::-1], triangles[:, ::-1], corners[:, ::-1]
        _write_obj(partial, f"{stem}.mtl", *mesh, len(pixels))
    return path


def atlas_texture(atlas: Atlas, chart: str) -> tuple[Floats, npt.NDArray[np.uint8]] | None:
    """(v, u) per vertex and the texture of a chart; None for one that has none.

    Where the atlas has the direct chart, the sealed surface, and the surface if nothing had
    to be closed, show its image, in which every sheet has a place of its own. Without it the
    surface shows what lies outermost over each pixel of uv. All show the mean curvature;
    the reference and the sphere that of the reference.

    Parameters
    ----------
    atlas : Atlas
    chart : str
        "surface", "sealed", "reference" or "sphere".
    """
    if atlas.has("direct") and (
        chart == "sealed" or (chart == "surface" and same_mesh(atlas.sealed, atlas.surface))
    ):
        return _direct_texture(atlas)
    needed = {"surface": "topography", "reference": "sphere", "sphere": "sphere"}
    if chart not in needed or not (atlas.has("uv") and atlas.has(needed[chart])):
        return None
    names = SURFACE_FIELDS if chart == "surface" else REFERENCE_FIELDS
    name = next((name for name in names if name in atlas.uv.fields), None)
    if name is None:
        return None
    values = atlas.uv.fields[name]
    colours = curvature_colours(values) if "curvature" in name else sequential(values, name)
    image = np.rint(255 * colours(values)).astype(np.uint8)
    if chart == "surface":
        return atlas.topography.surface[:, 1:], image
    turned = atlas.sphere.vertices @ atlas.uv.rotation.T
    return direction_to_uv(turned, atlas.uv.shape[0]), image


def _direct_texture(atlas: Atlas) -> tuple[Floats, npt.NDArray[np.uint8]] | None:
    name = DIRECT_FIELD
    if name not in atlas.surface.fields:
        return None
    chart = atlas.direct
    values = atlas.carry(np.nan_to_num(atlas.surface.fields[name]), "surface", "direct")
    image = np.rint(255 * curvature_colours(values)(values)).astype(np.uint8)
    return direction_to_uv(chart.vertices @ chart.rotation.T, chart.shape[0]), image


def texture_corners(vu: Floats, faces: Ints, rows: int) -> Floats:
    """(v, u) of every corner (m, 3, 2) such that no face spans the image.

    Parameters
    ----------
    vu : ndarray, (n, 2)
        (v, u) per vertex, NaN where it has no image.
    faces : ndarray, (m, 3)
    rows : int
        N; the image is 2N wide.

    Returns
    -------
    ndarray, (m, 3, 2)
        Across the seam u goes on beyond 2N, where the texture repeats. A corner at a pole
        has the u of the others; a face around a pole is the pole's pixel. NaN for faces
        with a corner without image.
    """
    vu, faces = _poles_split(vu, faces, rows)
    corners = vu[faces]
    corners[~np.isfinite(corners).all(axis=(1, 2))] = np.nan
    u = corners[:, :, 1]
    # As cut_at_seam does it; False for NaN.
    corners[:, :, 1] += 2.0 * rows * ((np.ptp(u, axis=1) > rows)[:, None] & (u < rows))
    _shrink_around_poles(corners, rows)
    return corners


def _poles_split(vu: Floats, faces: Ints, rows: int) -> tuple[Floats, Ints]:
    """Give each face its own vertex at a pole, with a u between those of its other corners."""
    at_pole = (vu[:, 0] < AT_POLE - 0.5) | (vu[:, 0] > rows - 0.5 - AT_POLE)
    face, corner = np.nonzero(at_pole[faces] & (at_pole[faces].sum(axis=1) == 1)[:, None])
    one, other = (vu[faces[face, (corner + k) % 3], 1] for k in (1, 2))
    between = np.mod(one + _around(other - one, rows) / 2, 2 * rows)
    new = np.column_stack([vu[faces[face, corner], 0], between])
    faces = faces.copy()
    faces[face, corner] = len(vu) + np.arange(len(face))
    return np.concatenate([vu, new]), faces


def _shrink_around_poles(corners: Floats, rows: int) -> None:
    """Make faces that run around a pole a point there: the image has no triangle for them."""
    u = corners[:, :, 1]
    turns = _around(np.roll(u, -1, axis=1) - u, rows).sum(axis=1) / (2 * rows)
    around = np.abs(turns) > 0.5  # False for NaN
    north = corners[around, :, 0].mean(axis=1) < rows / 2
    corners[around, :, 0] = np.where(north, 0.0, rows - 1.0)[:, None]
    corners[around, :, 1] = corners[around, :1, 1]


def _around(difference: Floats, rows: int) -> Floats:
    """A difference of u, the short way around: −N ≤ result < N."""
    shortest: Floats = np.mod(difference + rows, 2 * rows) - rows
    return shortest


def _checked_image(image: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    if image.ndim not in (2, 3) or image.shape[1] != 2 * image.shape[0]:
        raise AxesError("A texture is an image of N × 2N pixels.", shape=image.shape)
    if image.dtype != np.uint8 or (image.ndim == 3 and image.shape[2] != 3):
        raise InputError(
            "A texture holds red, green and blue, or grey, as uint8.",
            dtype=str(image.dtype),
            shape=image.shape,
            hint="Colour the values first.",
        )
    colours = image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)
    return np.ascontiguousarray(colours)


def _write_image(path: Path, pixels: npt.NDArray[np.uint8]) -> None:
    from matplotlib.image import imsave

    options: dict[str, Any] = {"metadata": {"Software": None}}
    imsave(path, pixels, format="png", **options)


def _write_material(path: Path, image: str) -> None:
    lines = [
        f"newmtl {MATERIAL}",
        "Ka 1 1 1",
        "Kd 1 1 1",
        "illum 1",
        f"map_Kd {image}",
        "",
        f"newmtl {WITHOUT_IMAGE}",
        "Kd 0.7 0.7 0.7",
        "illum 1",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_obj(
    path: Path, material: str, points: Floats, faces: Ints, corners: Floats, rows: int
) -> None:
    mapped = np.isfinite(corners).all(axis=(1, 2))
    places, index = np.unique(corners[mapped].reshape(-1, 2), axis=0, return_inverse=True)
    coordinates = (places[:, ::-1] + 0.5) / (2 * rows, rows)
    coordinates[:, 1] = 1.0 - coordinates[:, 1]
    pairs = np.stack([faces[mapped], index.reshape(-1, 3)], axis=2).reshape(-1, 6)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"# x, y, z in micrometres\nmtllib {material}\n")
        np.savetxt(file, points, fmt="v %.9g %.9g %.9g")
        np.savetxt(file, coordinates, fmt="vt %.9g %.9g")
        file.write(f"usemtl {MATERIAL}\n")
        np.savetxt(file, pairs + 1, fmt="f %d/%d %d/%d %d/%d")
        if not mapped.all():
            file.write(f"usemtl {WITHOUT_IMAGE}\n")
            np.savetxt(file, faces[~mapped] + 1, fmt="f %d %d %d")
