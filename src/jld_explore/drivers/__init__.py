"""Which labelling is asked next."""
