"""An organ-like body as a Gmsh mesh, in mm: python organ.py OUT.msh [SIZE]

The upper part of an ellipsoid with half axes 30, 20 and 15, cut by the plane z = -5 on which it is held. Any closed
shape will do: `gmsh.model.occ.importShapes` reads STEP and BREP files, `gmsh.merge` reads STL.
"""

import sys

import gmsh

out = sys.argv[1]
size = float(sys.argv[2]) if len(sys.argv) > 2 else 3.0

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
ball = occ.addSphere(0, 0, 0, 1)
occ.dilate([(3, ball)], 0, 0, 0, 30, 20, 15)
below = occ.addBox(-50, -50, -45, 100, 100, 40)  # up to z = -5
body, _ = occ.cut([(3, ball)], [(3, below)])
occ.synchronize()

surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
base = [tag for tag in surfaces if gmsh.model.getBoundingBox(2, tag)[5] < -4.9]
contact = [tag for tag in surfaces if tag not in base]
gmsh.model.addPhysicalGroup(2, base, name="base")
gmsh.model.addPhysicalGroup(2, contact, name="contact")
gmsh.model.addPhysicalGroup(3, [tag for _, tag in body], name="tissue")

# finer under the indenter, which presses from above at x = y = 0: its face must be covered by whole triangles
field = gmsh.model.mesh.field
growth = field.add("MathEval")
field.setString(growth, "F", f"{size} * Min(1, 0.15 + 0.0008 * (x*x + y*y + (z-15)*(z-15))^1.5)")
field.setAsBackgroundMesh(growth)
for option in ["MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"]:
    gmsh.option.setNumber(f"Mesh.{option}", 0)

gmsh.model.mesh.generate(3)
gmsh.model.mesh.optimize("Netgen")
gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
gmsh.option.setNumber("Mesh.Binary", 0)
gmsh.write(out)
