"""The learned model: slopes, and what must be known of surface, air and sky for them, from the same minutes.

`terms` turns a minute into the fluxes' dependence on what is unknown, `filters` steps many Kalman filters
side by side, one per hypothesis about exchange and layer, `hypotheses` draws these, `normals` imposes that
normals are unit vectors, `learner` is the chain that an estimator keeps.
"""
