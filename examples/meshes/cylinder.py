"""The preset `indentation`'s cylinder as a Gmsh mesh, in mm: python cylinder.py OUT.msh [SIZE]

Diameter 30, height 17, base at z = 0. The face of the indenter (diameter 10) is a disc of its own in the top, so that
the mesh has nodes on its rim; the cells grow from 0.19 SIZE there to SIZE (default 1.45).
"""

import sys

import gmsh

out = sys.argv[1]
size = float(sys.argv[2]) if len(sys.argv) > 2 else 1.45
edge = 0.19 * size

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
body = occ.addCylinder(0, 0, 0, 0, 0, 17, 15)
disc = occ.addDisk(0, 0, 17, 5, 5)
occ.fragment([(3, body)], [(2, disc)])
occ.synchronize()

surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
height = {tag: gmsh.model.getBoundingBox(2, tag)[2::3] for tag in surfaces}
base = [tag for tag in surfaces if max(height[tag]) < 0.1]
top = [tag for tag in surfaces if min(height[tag]) > 16.9]
gmsh.model.addPhysicalGroup(2, base, name="base")
gmsh.model.addPhysicalGroup(2, top, name="contact")
# Gmsh saves only what is in a group: the volume needs one as well
gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="tissue")

rim = [t for _, t in gmsh.model.getEntities(1) if abs(gmsh.model.getBoundingBox(1, t)[3] - 5) < 0.1]
field = gmsh.model.mesh.field
distance = field.add("Distance")
field.setNumbers(distance, "CurvesList", rim)
field.setNumber(distance, "Sampling", 200)
growth = field.add("MathEval")
field.setString(growth, "F", f"Min({edge} + 0.2 * F{distance}, {size})")
field.setAsBackgroundMesh(growth)
for option in ["MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"]:
    gmsh.option.setNumber(f"Mesh.{option}", 0)

gmsh.model.mesh.generate(3)
gmsh.model.mesh.optimize("Netgen")
gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
gmsh.option.setNumber("Mesh.Binary", 0)
gmsh.write(out)
