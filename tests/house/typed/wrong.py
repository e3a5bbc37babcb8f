"""Calls that a checker of types must refuse, each on a line that ends with the code of its error; never run."""

import exudyn as exu

import exudyn_partition as ep

fem = ep.fe_model("part.step", ep.STEEL)
part = ep.Partition.ball(fem, (0, 0, 0), 1e-3)
body = ep.reduce(fem, part, f_cut=1e4)
mbs = exu.SystemContainer().AddSystem()
item = ep.CreatePartitionBody(mbs, body)
contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
result = ep.solve_dynamic(mbs, end_time=1e-3)

ep.Reduce  # attr-defined
ep.reduce(fem, part, fcut=1e4)  # call-arg
ep.reduce(fem, part, f_cut="10 kHz")  # arg-type
ep.reduce(fem, part, f_cut=1e4, basis="craig_bampton")  # arg-type
ep.reduce(part, fem, f_cut=1e4)  # arg-type
ep.Material(E=210e9, nu=0.3, density=7850)  # call-arg
ep.Partition.ball(fem, (0, 0, 0), 1e-3, axes="normals")  # arg-type
ep.Partition.interface(fem, "pin", nodes="bore", kind="RBE2")  # arg-type
ep.CreatePartitionBody(mbs, body, frame="floting")  # arg-type
ep.CreatePartitionBody(mbs, body, inertiaTerms=["coriolys"])  # list-item
ep.CreatePartitionBody(mbs, body, initialVelocity="down")  # arg-type
ep.CreatePartitionContact(mbs, item, item, formulation="multipliers")  # call-overload
ep.CreatePartitionContact(mbs, item, item, rows="nodes")  # call-overload
ep.CreatePartitionContact(mbs, item, item, passes="two")  # call-overload
ep.CreatePartitionContact(mbs, body, item)  # call-overload
ep.solve_dynamic(mbs, end_time=1e-3, method="Newmark")  # arg-type
ep.solve_dynamic(mbs, 1e-3)  # call-arg
ep.reference.FullBody(fem, part, mass="diagonal")  # arg-type
ep.output.write_paraview("out", result, fields=["strain"])  # list-item
ep.view.show(result, field="stress")  # arg-type
ep.truncation_frequency(result.t, contact.force(result), window="hamming")  # arg-type
item.velocity(result)  # call-arg
result.forces  # attr-defined
