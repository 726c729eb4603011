"""What every column of the table of protrusions means: its title, its unit, its definition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

BARYCENTRIC = "a face whose corners have different labels counts a third for each corner"
MOMENTS = "of the ellipsoid with the second moments of the protrusion's voxels"


@dataclass(frozen=True)
class Column:
    """A column of the table: its title, its unit ("" = none) and its definition.

    `whole` is True where numbers of several protrusions can be added up.
    """

    title: str
    unit: str
    meaning: str
    whole: bool = False


COLUMNS: Mapping[str, Column] = {
    "label": Column("Label", "", "Number of the protrusion in the labels and the volume."),
    "motif": Column(
        "Motif",
        "",
        "A guess by the shape alone: lamellipodium where the base is at least twice as long as "
        "wide (elongation), else filopodium where it is at least twice as long as broad, else "
        "bleb.",
    ),
    "vertices": Column("Vertices", "", "Vertices of the surface with this label.", whole=True),
    "area_um2": Column(
        "Area", "µm²", f"Area of its surface without the base; {BARYCENTRIC}.", whole=True
    ),
    "volume_um3": Column("Volume", "µm³", "Number of its voxels times their volume.", whole=True),
    "height_max_um": Column("Height", "µm", "Largest height of its vertices over the cortex."),
    "height_mean_um": Column(
        "Mean height", "µm", "Height of its vertices over the cortex, weighted by area."
    ),
    "base_area_um2": Column(
        "Base area",
        "µm²",
        "Area of the footprint: where its voxels meet the cortex's, the voxels' faces projected "
        "along the normal of the smoothed cortex (σ = 2 voxels).",
        whole=True,
    ),
    "width_um": Column("Width", "µm", "Diameter of the disk with the area of the base."),
    "neck_um": Column(
        "Neck",
        "µm",
        "Smallest width from the base up to the widest place. Width: diameter of the disk with "
        "the area of the cross section, which is what lies as far from the base (shells of "
        "one voxel, mean of three).",
    ),
    "base_elongation": Column(
        "Elongation of the base",
        "",
        "Length of the footprint over its width: ratio of the standard deviations of its voxels "
        "along their first two principal axes.",
    ),
    "aspect": Column("Aspect", "", "Height over width."),
    "length_um": Column("Length", "µm", f"Longest axis {MOMENTS}."),
    "breadth_um": Column("Breadth", "µm", f"Middle axis {MOMENTS}."),
    "thickness_um": Column("Thickness", "µm", f"Shortest axis {MOMENTS}."),
    "sheetness": Column("Sheetness", "", "(Breadth - thickness) / length: 1 is a flat sheet."),
    "sphericity": Column(
        "Sphericity",
        "",
        "Area of the ball of its volume over the area of its surface and its base (Wadell "
        "1935, doi:10.1086/624298): 1 is a ball.",
    ),
    "solidity": Column(
        "Solidity",
        "",
        "Volume over that of the convex hull of the centres of its voxels' faces.",
    ),
    "mean_curvature_per_um": Column(
        "Mean curvature",
        "1/µm",
        "Mean curvature of the surface over its vertices, weighted by area; positive where it "
        "is convex.",
    ),
    "mean_curvature_max_per_um": Column(
        "Largest curvature", "1/µm", "Largest mean curvature of its vertices."
    ),
    "touching": Column("Touching", "", "How many other protrusions it meets on the surface."),
    "z_um": Column("z", "µm", "Centroid of its surface."),
    "y_um": Column("y", "µm", "Centroid of its surface."),
    "x_um": Column("x", "µm", "Centroid of its surface."),
    "v_px": Column(
        "v", "pixel", "Row of its mean direction on the sphere, weighted by area; see u."
    ),
    "u_px": Column(
        "u",
        "pixel",
        "Column of its mean direction on the sphere, so that neither the seam nor a pole matter.",
    ),
    "axis_z": Column(
        "Axis z",
        "",
        "Unit vector from the middle of the base to the middle of the volume; where these are "
        "within a voxel, the mean normal of the base.",
    ),
    "axis_y": Column("Axis y", "", "See axis z."),
    "axis_x": Column("Axis x", "", "See axis z."),
}
