"""Parts that no operator's session needs: pretraining, comparisons of methods, other methods, solvers and physics."""
