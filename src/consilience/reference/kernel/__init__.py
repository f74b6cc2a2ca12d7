"""Ground of the compiled solver: decorators, small vectors, factorisations, functions of time."""
