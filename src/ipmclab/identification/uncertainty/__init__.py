"""How sure a fit is: covariance, intervals, profiles of the likelihood, readings drawn anew."""
