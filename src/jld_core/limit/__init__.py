"""A raw answer → a proof: bounds, repairs, status, result."""
