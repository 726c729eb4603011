"""The cells, organs and shapes that the core is measured on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import napari_unwrap3d as unwrap3d

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"

KINDS = ("blebs", "lamellipodia", "filopodia", "touching_filopodia", "handles", "mix")
SEEDS = (0, 1, 2)
FRAMES = range(21)
FULL, HALF = 512, 256  # rows N of the uv image: 1024 × 512 and 512 × 256 pixels

# Every cell of the ovule's crop reaches its border. These are the five largest of which less
# than 4 % of the voxels lie on it; they are closed there with a flat cut.
OVULE_LABELS = (525, 809, 673, 292, 165)

Source = unwrap3d.Stack | unwrap3d.Mask | unwrap3d.Surface


@dataclass(frozen=True)
class Case:
    """One input, how it is unwrapped, and whether it may end with a clear error."""

    name: str
    load: Callable[[], Source]
    rows: int
    parameters: dict[str, Any] = field(default_factory=dict)
    may_stop: bool = False
    file: Path | None = None

    @property
    def grid(self) -> str:
        return f"{2 * self.rows}×{self.rows}"

    @property
    def absent(self) -> bool:
        """Whether the file of this case is not beside the project."""
        return self.file is not None and not self.file.exists()

    def all_parameters(self) -> unwrap3d.Parameters:
        """The defaults, the rows of the grid, and what this case needs."""
        return unwrap3d.Parameters.from_dict({"uv": {"rows": self.rows}, **self.parameters})


def all_cases() -> dict[str, Case]:
    """Every case by its name, simulated cells first."""
    cases = [*_simulated(), *_meshes(), *_stacks(), *_droplet(), *_ovule()]
    return {case.name: case for case in cases}


def simulated_name(kind: str, seed: int) -> str:
    return f"{kind.replace('_', '-')}-{seed}"


def simulated(kind: str, seed: int) -> Any:
    """A simulated cell of the default size (200³ voxels), with its truth."""
    return unwrap3d.simulate.cell(kind, seed)


def _simulated() -> list[Case]:
    masks = [_simulated_case(kind, seed) for seed in SEEDS for kind in KINDS]
    return masks + [_simulated_case(kind, 0, stack=True) for kind in KINDS]


def _simulated_case(kind: str, seed: int, stack: bool = False) -> Case:
    """The true mask of a simulated cell, or the stack that was recorded of it."""

    def load() -> Source:
        cell = simulated(kind, seed)
        source: Source = cell.stack if stack else cell.truth.mask
        return source

    return Case(
        simulated_name(kind, seed) + ("-stack" if stack else ""),
        load,
        rows=FULL if seed == 0 and not stack else HALF,
        may_stop=kind == "touching_filopodia",
    )


def _meshes() -> list[Case]:
    files = [f"midgut_mesh_{frame:02d}.ply" for frame in (1, 5, 10, 15, 20)]
    files += ["branchoid.ply", "spot.obj", "gastruloid.ply", "knot.ply", "torus.obj"]
    cases = []
    for file in files:
        path = DATA / "meshes" / file
        name = path.stem.replace("_mesh_", "-")
        cases.append(
            Case(
                name,
                lambda path=path: unwrap3d.read_mesh(path),
                rows=HALF,
                may_stop=name == "branchoid",
                file=path,
            )
        )
    return cases


def _stacks() -> list[Case]:
    embryo = DATA / "stacks" / "Drosophila_CAAX-mCherry-tiny.tif"
    organoid = DATA / "stacks" / "Neural_tube_organoid_DAPI_betaCat-small.tif"
    return [
        Case(
            "embryo",
            lambda: unwrap3d.read_stack(embryo, voxel_size=(1, 1, 1)),
            rows=HALF,
            file=embryo,
        ),
        *(
            Case(
                f"organoid-{stain}",
                lambda: unwrap3d.read_stack(organoid),
                rows=HALF,
                parameters={"stack": {"channel": channel}},
                file=organoid,
            )
            for channel, stain in enumerate(("dapi", "betacat"))
        ),
    ]


def _droplet() -> list[Case]:
    path = DATA / "stacks" / "ExampleTifSequence.tif"
    # The droplet is 12 voxels wide: on a working grid of its own voxels, half a voxel of
    # smoothing is a tenth of its volume.
    return [
        Case(
            f"droplet-{frame:02d}",
            lambda: unwrap3d.read_stack(path, voxel_size=(1, 1, 1)),
            rows=HALF,
            parameters={"stack": {"timepoint": frame, "working_voxel_um": 0.25}},
            file=path,
        )
        for frame in FRAMES
    ]


def _ovule() -> list[Case]:
    path = DATA / "stacks" / "plantseg_sample_ovule.h5"
    return [
        Case(
            f"ovule-{label}",
            lambda: unwrap3d.read_stack(path, dataset="label"),
            rows=HALF,
            parameters={"stack": {"label": label}},
            file=path,
        )
        for label in OVULE_LABELS
    ]
