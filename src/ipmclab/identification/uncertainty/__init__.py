"""How sure a fit is: covariance, intervals, where the likelihood ends them."""
