"""What an operator's session never needs: pretraining, comparisons of methods, other methods, solvers and physics."""
