"""Writes a Gmsh mesh as VTU in every form that meshio knows: python to_vtu.py IN.msh FOLDER

The surface groups become point arrays of 0 and 1.
"""

import pathlib
import sys

import meshio
import numpy as np

source, folder = sys.argv[1], pathlib.Path(sys.argv[2])
mesh = meshio.read(source)
data = {}
for name in ["base", "contact"]:
    members = np.zeros(len(mesh.points))
    for block, inside in zip(mesh.cells, mesh.cell_sets[name]):
        members[np.unique(block.data[inside])] = 1
    data[name] = members
tetra = [("tetra", mesh.cells_dict["tetra"])]
out = meshio.Mesh(mesh.points, tetra, point_data=data)
meshio.vtu.write(folder / "ascii.vtu", out, binary=False)
meshio.vtu.write(folder / "zlib.vtu", out, binary=True, compression="zlib")
meshio.vtu.write(folder / "plain.vtu", out, binary=True, compression=None)

# the same groups as arrays of the cells: 1 on the triangles of a group
cells = [("triangle", mesh.cells_dict["triangle"])] + tetra
marks = {
    name: [
        np.concatenate([np.isin(np.arange(len(b.data)), inside) for b, inside in zip(mesh.cells, mesh.cell_sets[name]) if b.type == "triangle"]).astype(np.int32),
        np.zeros(len(tetra[0][1]), dtype=np.int32),
    ]
    for name in data
}
meshio.vtu.write(folder / "cells.vtu", meshio.Mesh(mesh.points, cells, cell_data=marks), binary=True)
