"""Collapse without dilation: a solution of one labelling, the lowest and the highest there are, a proven bound below.

In the order data flows: `solve` (what one labelling is asked), `search` (one solution), `starts`, `pivots`, `found` and
`range` (many, and the lowest and highest of them), `proof` (what that proves). Below them all: in the plane `modes`,
`statics`, `frozen`, `products` (the program), `around`, `normal`, `repair`, `blocks` (the same, large), `certificate`
over `binary_fractions`, `sweep` and `floor` (steps and branches) under one `ceiling`; in space `space_modes`,
`space_statics`, `space_products`, `space_certificate`, `space_floor`.
"""
