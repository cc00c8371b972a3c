"""Methods of others, and the extras that they need; `sim.adaptation.methods` names them."""
