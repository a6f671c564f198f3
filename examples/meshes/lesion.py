"""An organ with a tumour and a vessel as a Gmsh mesh of three volume groups, in mm: python lesion.py OUT.msh [SIZE]

The upper part of an ellipsoid with half axes 36, 26 and 24, held on the plane z = -8. The tumour is a ball of radius 5 whose
centre lies 15 below the top; the vessel is a bent tube of radius 2.5 beside it. A needle comes down at x = y = 0: a cylinder of
its capture radius, 1, is a part of its own in all that it goes through, so that the mesh has nodes on that radius.
"""

import sys

import gmsh

out = sys.argv[1]
size = float(sys.argv[2]) if len(sys.argv) > 2 else 4.0
CAPTURE, DEEPEST = 1.0, 22.0

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
ball = occ.addSphere(0, 0, 0, 1)
occ.dilate([(3, ball)], 0, 0, 0, 36, 26, 24)
below = occ.addBox(-50, -50, -58, 100, 100, 50)  # up to z = -8
whole, _ = occ.cut([(3, ball)], [(3, below)])

tumour = occ.addSphere(0, 0, 9, 5)
middle = [occ.addPoint(*p) for p in [(-20, -34, 4), (6, -13, 8), (10, 0, 10), (6, 13, 8), (-20, 34, 4)]]
wire = occ.addWire([occ.addSpline(middle)])
disc = occ.addDisk(-20, -34, 4, 2.5, 2.5, zAxis=[26, 21, 4], xAxis=[0, 4, -21])
tube = occ.addPipe([(2, disc)], wire)
occ.remove([(2, disc)], recursive=True)
vessel, _ = occ.intersect(tube, whole, removeTool=False)
path = occ.addCylinder(0, 0, 24 - DEEPEST, 0, 0, DEEPEST + 2, CAPTURE)
inner, _ = occ.intersect([(3, path)], whole, removeTool=False)

parts = whole + [(3, tumour)] + vessel + inner
_, became = occ.fragment(parts[:1], parts[1:])
occ.synchronize()
of = {name: {tag for _, tag in became[k]} for name, k in [("tumour", 1), ("vessel", 2)]}
of["organ"] = {tag for _, tag in became[0]} - of["tumour"] - of["vessel"]
for name, volumes in of.items():
    gmsh.model.addPhysicalGroup(3, sorted(volumes), name=name)

outside = {abs(tag) for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(3), combined=True, oriented=False)}
base = {tag for tag in outside if gmsh.model.getBoundingBox(2, tag)[5] < -7.9}
gmsh.model.addPhysicalGroup(2, sorted(base), name="base")
gmsh.model.addPhysicalGroup(2, sorted(outside - base), name="contact")

# fine along the needle, finer in the tumour and the vessel than in the rest
field = gmsh.model.mesh.field
needle = field.add("MathEval")
field.setString(needle, "F", f"{0.5 * CAPTURE} + 0.35 * Max(0, (x*x + y*y + (Max(0, {24 - DEEPEST} - z))^2)^0.5 - {CAPTURE})")
inside = field.add("Constant")
field.setNumber(inside, "VIn", 0.6 * size)
field.setNumber(inside, "VOut", size)
field.setNumbers(inside, "VolumesList", sorted(of["tumour"] | of["vessel"]))
least = field.add("Min")
field.setNumbers(least, "FieldsList", [needle, inside])
field.setAsBackgroundMesh(least)
for option in ["MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"]:
    gmsh.option.setNumber(f"Mesh.{option}", 0)

gmsh.model.mesh.generate(3)
gmsh.model.mesh.optimize("Netgen")
gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
gmsh.option.setNumber("Mesh.Binary", 0)
gmsh.write(out)
