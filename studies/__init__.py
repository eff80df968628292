"""One script per question; each ends in a table and a picture. `make studies` runs them all."""

import os

# the matrices are small: threads inside one product cost more than the product, many times over on a busy machine
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
