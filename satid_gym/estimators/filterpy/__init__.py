"""Reference filters: the same models in plain numpy around filterpy's algebra, to check the compiled ones."""
