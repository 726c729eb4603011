"""The direct chart: the sealed surface itself on the sphere, one to one, in place.

Under overhangs several sheets of the surface lie over one pixel of the reference's (u, v)
image, so that it cannot show all of them. The direct chart can: the sealed surface's own
mesh is embedded on the sphere without a flip (:mod:`..geometry.spherical_embedding`), and
where the reference's image shows a single sheet, vertices are tied to their place in it,
so that the cortex lies where a user knows it from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse

from ..charts import UV, Direct, Floats, Ints, SealedSurface, Surface, Topography
from ..geometry.distortion import spherical_determinants
from ..geometry.locate import SphericalLocator, largest_column
from ..geometry.padding import pad_sphere, sample_uv_nearest
from ..geometry.spherical_embedding import EmbeddingWeights, embed_on_sphere
from ..geometry.spherical_raster import coverage
from ..parameters import DirectParameters
from ..progress import Progress
from .surface import same_mesh
from .topography import TopographyLocator
from .uv import direction_to_uv, pixel_grid, uv_to_direction

# Grid on which sheets are counted, and by how many of its pixels several of them spread.
COVERAGE_ROWS, COVERAGE_MARGIN = 256, 1


@dataclass(frozen=True, eq=False)
class Registration:
    """Where the reference's (u, v) image puts the sealed surface's vertices.

    Attributes
    ----------
    directions : ndarray, (n, 3)
        Unit vectors in the sphere's frame; zero where a vertex has no image.
    single : ndarray, (n,) bool
        Whether a vertex lies where the image shows one sheet: the cortex.
    """

    directions: Floats
    single: npt.NDArray[np.bool_]


def direct(
    sealed: SealedSurface,
    surface: Surface,
    uv: UV,
    topography: Topography,
    voxel_um: float,
    parameters: DirectParameters,
    progress: Progress,
) -> Direct:
    """Embed the sealed surface on the sphere, registered with the reference's (u, v).

    Raises
    ------
    FlippedFacesError
        The certificate of the embedding does not hold.
    """
    progress(0.0, "looking for single sheets")
    places = registration(sealed, surface, uv, topography, voxel_um, progress.part(0.0, 0.05))
    directions = embed_on_sphere(
        sealed.vertices,
        sealed.faces,
        progress.part(0.05, 0.95),
        towards=places.directions,
        confidence=places.single.astype(np.float64),
        weights=EmbeddingWeights(
            shape=parameters.shape,
            tie=parameters.registration,
            slack=parameters.slack_rad,
            sweeps=parameters.sweeps,
            final_sweeps=parameters.final_sweeps,
        ),
    )
    progress(0.95, "drawing the image")
    return progress.run(direct_chart, sealed, directions, uv.rotation, parameters.rows, places)


def direct_chart(
    sealed: SealedSurface, directions: Floats, rotation: Floats, rows: int, places: Registration
) -> Direct:
    """The chart of an embedding: its image, and which vertex each pixel belongs to.

    Parameters
    ----------
    directions : ndarray, (n, 3)
        Unit vectors in the sphere's frame, without flips.
    rotation : ndarray, (3, 3)
        The unwrapping rotation.
    rows : int
        N.
    """
    turned = directions @ rotation.T
    pixels = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows)
    face, weights = SphericalLocator(turned, sealed.faces).locate(pixels)
    face, weights = face.reshape(rows, 2 * rows), weights.reshape(rows, 2 * rows, 3)
    owner, spokesman = ownership(sealed, face, weights, direction_to_uv(turned, rows))
    return Direct(
        vertices=directions,
        faces=sealed.faces,
        rotation=rotation,
        face=face,
        weights=weights,
        owner=owner,
        spokesman=spokesman,
        registered=places.directions,
        cortex=places.single,
    )


def registration(
    sealed: SealedSurface,
    surface: Surface,
    uv: UV,
    topography: Topography,
    voxel_um: float,
    progress: Progress,
) -> Registration:
    """Directions of the sealed surface's vertices in the reference's image, and the cortex."""
    if same_mesh(sealed, surface):
        image = topography.surface
    else:
        locator = TopographyLocator(topography.nodes, topography.d_um, voxel_um)
        image, _ = locator.locate(sealed.vertices, progress)
    mapped = np.asarray(np.isfinite(image).all(axis=1))
    turned = np.zeros((len(image), 3))
    turned[mapped] = uv_to_direction(image[mapped, 1:], uv.shape[0])
    single = mapped & ~_over_others(turned, sealed.faces[mapped[sealed.faces].all(axis=1)])
    flipped = ~(spherical_determinants(turned, sealed.faces) > 0)
    single[np.unique(sealed.faces[flipped])] = False
    return Registration(turned @ uv.rotation, single)


def _over_others(turned: Floats, faces: Ints) -> npt.NDArray[np.bool_]:
    """Whether vertices lie over pixels that more than one sheet covers."""
    several = pad_sphere(coverage(turned, faces, COVERAGE_ROWS) > 1, COVERAGE_MARGIN)
    spread = ndimage.binary_dilation(several, np.ones((3, 3)), iterations=COVERAGE_MARGIN)
    inner = (slice(COVERAGE_MARGIN, -COVERAGE_MARGIN),) * 2
    return sample_uv_nearest(spread[inner], direction_to_uv(turned, COVERAGE_ROWS))


def ownership(
    sealed: SealedSurface, face: Ints, weights: Floats, places: Floats
) -> tuple[Ints, Ints]:
    """Which vertex each pixel belongs to, and whose pixels speak for each vertex.

    Parameters
    ----------
    sealed : SealedSurface
    face : ndarray, (N, 2N), weights : ndarray, (N, 2N, 3)
        Where in its mesh each pixel's centre lies.
    places : ndarray, (n, 2)
        (v, u) of its vertices.

    Returns
    -------
    owner : ndarray, (N, 2N) int64
        The nearest corner of the face, or a vertex in the pixel that would have none.
    spokesman : ndarray, (n,) int64
        Itself, or the nearest vertex that has a pixel.
    """
    owner = sealed.faces[face, weights.argmax(axis=-1)].ravel()
    _give_pixels(owner, places, len(face))
    return owner.reshape(face.shape), spokesmen(sealed.vertices, sealed.faces, np.unique(owner))


def _give_pixels(owner: Ints, places: Floats, rows: int) -> None:
    """Give vertices without a pixel the one they lie in, if its owner has others; in place.

    Parameters
    ----------
    owner : ndarray, (2N²,) int64
    places : ndarray, (n, 2)
        (v, u) of the vertices.
    """
    count = np.bincount(owner, minlength=len(places))
    without = np.flatnonzero(count == 0)
    numbers = np.arange(owner.size).reshape(rows, 2 * rows)
    for vertex, pixel in zip(without, sample_uv_nearest(numbers, places[without]), strict=True):
        if count[owner[pixel]] > 1:
            count[owner[pixel]] -= 1
            owner[pixel] = vertex
            count[vertex] = 1


def spokesmen(vertices: Floats, faces: Ints, owners: Ints) -> Ints:
    """For each vertex the nearest one along the edges that owns a pixel (itself if it does)."""
    size = len(vertices)
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    length = np.linalg.norm(vertices[a] - vertices[b], axis=1)
    # A length of zero would be no edge at all.
    length = np.maximum(length, 1e-9 * max(float(length.max(initial=0.0)), 1e-300))
    edges = sparse.csr_array((length, (a, b)), shape=(size, size))
    _, _, nearest = sparse.csgraph.dijkstra(
        edges, directed=False, indices=owners, min_only=True, return_predecessors=True
    )
    return np.asarray(nearest, dtype=np.int64)


def labels_of_owners(chart: Direct, image: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """Labels (n,) of the sealed surface's vertices from an image (N, 2N) of labels.

    A vertex takes the label that most of its pixels have; one without a pixel takes that of
    its spokesman.
    """
    names, index = np.unique(image, return_inverse=True)
    owner = chart.owner.ravel()
    size = len(chart.vertices)
    votes = sparse.csr_array(
        (np.ones(owner.size), (owner, index.ravel())), shape=(size, len(names))
    )
    winner = np.zeros(size, np.int64)
    owners = np.flatnonzero(np.diff(votes.indptr))
    winner[owners] = largest_column(votes[owners])
    result: npt.NDArray[np.integer] = names[winner[chart.spokesman]]
    return result
