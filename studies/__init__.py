"""One script per question; each ends in a table and a picture. `make studies` runs them all."""
