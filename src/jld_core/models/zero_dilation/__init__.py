"""Collapse without dilation (zero-dilation friction) of one labelling.

The package computes one solution, the lowest and the highest solution found, and a proven lower bound on λ of all.
Modules in the order of data flow:

- one solution: `solve` (entry point), `fixed_point_search`, `primal_dual_pair`, `proof` (conversion to a `Proof`)
- lowest and highest solution: `starts`, `alternating_programs`, `multi_start_search`, `range`
- common to all lower bounds: `lower_bound_problem`, `frozen_friction`, `rlt_relaxation`, `binary_fractions`
- lower bound in the plane: `modes`, `loops`, `statics`, `bounded_modes`, `certificate`, `lower_bound`
- the same for large scenes: `product_space`, `normal_equations`, `interior_point`, `matrix_blocks`, `sweep`

Terms of the lower bounds, with formulas in docs/method.md (4.6) to (4.9):

- Φ = (F, λ, 1) are forces and load factor, w = (u, t) velocities and slides, X = Φ wᵀ their products.
- A mode is a rate z ≥ 0 of a hinge or a slide. The slack of its yield row is y ≥ 0, and y z = 0 in a solution.
- A closed mode has z = 0, a held mode has y = 0, in all solutions of a region.
- The cost of a mechanism is Σ_hinges z + Σ_faces C |slip|, C the friction or shear capacity of the face.
- The slack σ is the decrease of λ per unit of cost in a program. It gives the multipliers the margin that a proof
  in exact arithmetic needs, and lowers the bound.
- Force bounds are upper bounds on |Φ|, velocity bounds upper bounds on |w| per unit of cost.
- m, n and q are the numbers of faces, free elements and resultants; 2e is the number of forms from loops.
"""
