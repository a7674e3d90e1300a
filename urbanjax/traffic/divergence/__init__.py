"""How differently teams drive: estimates of the Kullback-Leibler divergence from nearest neighbours."""
