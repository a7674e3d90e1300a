"""The paper's Table I, a factorial study of its parameters, and the covariance."""
