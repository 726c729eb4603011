"""Disjoint sets as trees of parents, for compiled kernels."""

from __future__ import annotations

import numba


@numba.njit(nogil=True, cache=True)
def root(parent, node):  # type: ignore[no-untyped-def]
    """The node that stands for a node's set; paths are halved on the way."""
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return node
