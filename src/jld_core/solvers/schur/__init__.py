"""An interior point on the Schur complement, for large assemblies."""
