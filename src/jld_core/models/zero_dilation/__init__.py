"""Collapse without dilation (zero-dilation friction) of one labelling.

The package computes one solution, the lowest and the highest solution found, and a proven lower bound on λ of all.
Modules in the order of data flow:

- one solution: `solve` (entry point), `search` (fixed-point search), `proof` (conversion to a `Proof`)
- lowest and highest solution: `starts`, `pivots`, `found`, `range`
- common to all lower bounds: `lower_bound_problem`, `frozen`, `rlt_relaxation`, `binary_fractions`
- lower bound in the plane: `modes`, `loops`, `statics`, `certificate`, `lower_bound`
- lower bound in the plane, large scenes: `product_space`, `normal`, `interior`, `blocks`, `sweep`
- lower bound in space: the study `studies/spatial_bound`

Terms of the lower bounds, with formulas in docs/method.md (4.6) to (4.9):

- Φ = (F, λ, 1) are forces and load factor, w = (u, t) velocities and slides, X = Φ wᵀ their products.
- A mode is a rate z ≥ 0 of a hinge or a slide. The slack of its yield row is y ≥ 0, and y z = 0 in a solution.
- A closed mode has z = 0, a held mode has y = 0, in all solutions of a region.
- The cost of a mechanism is Σ_hinges z + Σ_faces C |slip|, C the friction or shear capacity of the face.
- The slack σ is the decrease of λ per unit of cost in a program. It gives the multipliers the margin that a proof
  in exact arithmetic needs, and lowers the bound.
- `force_bounds` are upper bounds on |Φ|, `velocity_bounds` upper bounds on |w| per unit of cost.
- m, n and q are the numbers of faces, free elements and resultants; 2e is the number of forms from loops.
"""
