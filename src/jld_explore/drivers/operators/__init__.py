"""How a labelling is changed."""
