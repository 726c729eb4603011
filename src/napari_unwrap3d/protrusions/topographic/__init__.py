"""The paper's way to protrusions, in (d, u, v): height, binary, instances, volumes.

doi:10.1101/2023.04.12.536640, Methods, from "Reference surface inference for measurement of
protrusion height" to "Topography guided decomposition of cell surface". In this space every
protrusion points up.
"""
