"""A small atlas whose charts are known in closed form, made without the pipeline."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import (
    UV,
    Floats,
    Ints,
    Mask,
    Plane,
    Protrusions,
    Reference,
    SealedSurface,
    Sphere,
    Surface,
    Topography,
    Volume,
)
from napari_unwrap3d.parameters import Parameters, PlaneParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.protrusions.segment import Segmentation, measured
from napari_unwrap3d.unwrapping.direct import Registration, direct_chart
from napari_unwrap3d.unwrapping.plane import certify, flattened, plane_chart

RADIUS = 4.0
CENTRE = 6.0
VOXEL = 0.25


def icosphere(subdivisions: int = 3) -> tuple[Floats, Ints]:
    """Unit vectors (n, 3) and faces (m, 3) of positive signed volume."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    vertices = np.asarray(mesh.vertices, dtype=float)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()
    return vertices, faces if volume > 0 else faces[:, ::-1].copy()


def height(directions: Floats) -> Floats:
    """Height of the cell over its reference in µm: three bumps and a dent."""
    bumps = [
        ((1, 0.2, 0.1), 1.0),
        ((-0.3, 1, 0.3), 0.8),
        ((0.1, -0.5, 0.9), 0.6),
        ((0, 0, -1), -0.5),
    ]
    total = np.zeros(directions.shape[:-1])
    for axis, amplitude in bumps:
        unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
        total += amplitude * np.exp((directions @ unit - 1) / 0.05)
    return total


def pixel_directions(rows: int) -> Floats:
    """Unit vectors (N, 2N, 3) of the pixel centres."""
    v = (np.arange(rows) + 0.5) * np.pi / rows
    u = (np.arange(2 * rows) + 0.5) * np.pi / rows - np.pi
    inclination, azimuth = np.meshgrid(v, u, indexing="ij")
    sine = np.sin(inclination)
    return np.stack([np.cos(inclination), sine * np.sin(azimuth), sine * np.cos(azimuth)], axis=-1)


def to_uv(directions: Floats, rows: int) -> Floats:
    """Unit vectors (n, 3) as (v, u) in pixels."""
    v = np.arccos(np.clip(directions[:, 0], -1, 1)) * rows / np.pi - 0.5
    u = (np.arctan2(directions[:, 1], directions[:, 2]) + np.pi) * rows / np.pi - 0.5
    return np.stack([v, u], axis=1)


def locate(directions: Floats, vertices: Floats, faces: Ints) -> tuple[Ints, Floats]:
    """Face and barycentric weights of each direction, by trying every face."""
    inverse = np.linalg.inv(vertices[faces].transpose(0, 2, 1))
    weights = np.einsum("fij,pj->pfi", inverse, directions)
    face = np.argmax(weights.min(axis=2), axis=1)
    chosen = weights[np.arange(len(face)), face]
    return face.astype(np.int64), chosen / chosen.sum(axis=1, keepdims=True)


def solid(radius: Any) -> Mask:
    """The cell or its reference on the working grid; `radius` takes directions."""
    n = int(2 * CENTRE / VOXEL)
    grid = np.stack(np.meshgrid(*[np.arange(n) * VOXEL - CENTRE] * 3, indexing="ij"), axis=-1)
    distance = np.linalg.norm(grid, axis=-1)
    directions = grid / np.maximum(distance, 1e-9)[..., None]
    return Mask(distance < radius(directions), (VOXEL,) * 3)


def make_uv(vertices: Floats, faces: Ints, rows: int) -> UV:
    directions = pixel_directions(rows)
    face, weights = locate(directions.reshape(-1, 3), vertices, faces)
    shape = directions.shape[:2]
    fields = {
        "conformal_error": np.full(shape, 1.003),
        "area_distortion": np.exp(0.02 * np.cos(4 * np.arange(2 * rows))) * np.ones(shape),
        "area_um2": np.full(shape, 4 * np.pi * RADIUS**2 / (2 * rows**2)),
        "mean_curvature_per_um": np.full(shape, 1 / RADIUS),
        "surface_height_um": height(directions),
        "surface_mean_curvature_per_um": 1 / RADIUS + 0.5 * height(directions),
    }
    return UV(
        rotation=np.eye(3),
        face=face.reshape(shape),
        weights=weights.reshape(*shape, 3),
        positions=CENTRE + RADIUS * directions,
        fields=fields,
    )


def make_topography(surface: Surface, vertices: Floats, rows: int) -> Topography:
    directions = pixel_directions(rows)
    poles = np.zeros((1, 2 * rows, 3))
    poles[..., 0] = 1.0
    with_poles = np.concatenate([poles, directions, -poles])
    d_um = np.arange(-1.0, 2.0, VOXEL / 2)
    radii = (RADIUS + d_um)[:, None, None, None]
    uv = to_uv(vertices, rows)
    flat = np.column_stack([height(vertices), uv])
    u = uv[surface.faces, 1]
    kept = surface.faces[u.max(axis=1) - u.min(axis=1) < rows]
    return Topography(
        nodes=(CENTRE + radii * with_poles).astype(np.float32),
        d_um=d_um,
        first_layer=np.zeros(with_poles.shape[:2], dtype=np.int64),
        last_layer=np.full(with_poles.shape[:2], len(d_um) - 1),
        mask=height(directions) > d_um[:, None, None],
        surface=flat,
        cut_vertices=flat,
        cut_faces=kept,
        cut_origin=np.arange(len(flat)),
        meshed_vertices=surface.vertices,
        meshed_faces=surface.faces,
    )


def make_plane(surface: Surface, flat: Floats, rows: int) -> Plane:
    attempt = flattened(flat, surface.faces, rows, PlaneParameters(), silent())
    pixels = certify(attempt.flat, surface.vertices)
    return plane_chart(surface, attempt, pixels, of_sealed=False)


def make_atlas(subdivisions: int = 3, rows: int = 32) -> Atlas:
    """A round cell with three bumps and a dent, every chart filled in."""
    vertices, faces = icosphere(subdivisions)
    h = height(vertices)
    cell = solid(lambda directions: RADIUS + height(directions))
    ball = solid(lambda directions: RADIUS)
    surface = Surface(
        CENTRE + (RADIUS + h)[:, None] * vertices,
        faces,
        {
            "mean_curvature_per_um": 1 / RADIUS + 0.5 * h,
            "gaussian_curvature": np.full(len(h), 4 * np.pi / len(h)),
            "height_um": np.where(h > 0.99, np.nan, h),
        },
        report={"genus": 0, "repairs": [], "quality": float("nan")},
    )
    reference = Reference(
        CENTRE + RADIUS * vertices,
        faces,
        {"mean_curvature_per_um": np.full(len(h), 1 / RADIUS)},
        mask=ball,
        level=Volume(np.linspace(-1, 1, 27, dtype=np.float32).reshape(3, 3, 3), (VOXEL,) * 3),
        iteration=6,
        total_curvature=1 + 3 * np.exp(-np.arange(21) / 4.0),
        stopped_by="total_curvature",
    )
    sealed = ({"kind": "handle", "position_um": [1.0, 2.0, 3.0], "volume_um3": 0.5},)
    closed = SealedSurface(surface.vertices, faces, mask=cell, sealed=sealed)
    everywhere = Registration(vertices, np.ones(len(vertices), bool))
    topography = make_topography(surface, vertices, rows)
    return Atlas(
        surface=surface,
        sealed=closed,
        reference=reference,
        sphere=Sphere(vertices, faces, conformal=vertices, error_history=np.array([0.1, 0.01])),
        uv=make_uv(vertices, faces, rows),
        topography=topography,
        mask=cell,
        parameters=Parameters.preset("ruffles"),
        quality={
            "stack": {"voxels": int(cell.data.sum())},
            "surface": {"genus": 0, "euler_characteristic": 2, "watertight": True},
            "reference": {"genus": 0, "iteration": 6},
            "sphere": {"flipped_faces": 0, "mean_q": 1.003, "not_known": float("nan")},
            "uv": {"unlocated_pixels": 0},
            "topography": {"folded_cells": 0, "folded_fraction": 0.0},
            "direct": {"flipped_faces": 0, "mean_abs_log_lambda": 0.1},
        },
        provenance={
            "versions": {"napari-unwrap3d": "0.1"},
            "source": {"name": "synthetic", "kind": "surface", "hash": "0"},
            "steps": {"surface": {"seconds": 1.5, "key": "abc"}},
            "repairs": ["one handle was closed"],
        },
        on_request={
            "direct": direct_chart(closed, vertices, np.eye(3), rows, everywhere),
            "plane": make_plane(surface, topography.surface, rows),
        },
    )


def known_protrusions(atlas: Atlas) -> Protrusions:
    """The three bumps of :func:`height`, each from 0.1 µm over the reference, as protrusions."""
    axes = np.array([[1, 0.2, 0.1], [-0.3, 1, 0.3], [0.1, -0.5, 0.9]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)

    def label(points: Floats) -> npt.NDArray[np.int32]:
        away = points - CENTRE
        radius = np.linalg.norm(away, axis=-1)
        direction = away / np.maximum(radius, 1e-9)[..., None]
        nearest = 1 + (direction @ axes.T).argmax(axis=-1)
        high = (height(direction) > 0.1) & (radius > RADIUS)
        return np.where(high, nearest, 0).astype(np.int32)

    mask = atlas.mask
    places = mask.to_world(np.indices(mask.shape).reshape(3, -1).T)
    volume = np.where(mask.data, label(places).reshape(mask.shape), 0).astype(np.int32)
    over = np.linalg.norm(atlas.surface.vertices - CENTRE, axis=1) - RADIUS
    found = Segmentation(
        label(atlas.surface.vertices), over, volume, mask.data & (volume == 0), {"made": "by hand"}
    )
    image, rows = atlas.topography.surface, atlas.topography.shape[1]
    return measured(found, mask, atlas.surface, image, "cortex", rows=rows)


def with_protrusions(atlas: Atlas) -> Atlas:
    """A copy of the atlas with :func:`known_protrusions`, and without annotations."""
    kept = {name: getattr(atlas, name) for name in type(atlas).__dataclass_fields__}
    found = known_protrusions(atlas)
    quality = {**atlas.quality, "protrusions": dict(found.numbers)}
    on_request = {**atlas.on_request, "protrusions": found}
    return Atlas(**{**kept, "on_request": on_request, "quality": quality})
