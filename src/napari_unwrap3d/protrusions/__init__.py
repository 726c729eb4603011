"""Protrusions: what stands out of the cell's cortex, one by one, with volume and measures.

Two methods give the same :class:`~napari_unwrap3d.charts.Protrusions`: over the cortex, the
cell opened by a ball (:mod:`.over_cortex`, :mod:`.instances`, :mod:`.volumes`), and the paper's
way in (d, u, v) (:mod:`.topographic`).
"""
