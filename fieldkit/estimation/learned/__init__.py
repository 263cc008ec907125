"""The learned model: slopes, and what must be known of surface, air and sky for them, from the same minutes.

`inputs` are the numbers of a minute, `surface` the equations of its temperatures and fluxes, `bank` the
Kalman filters, one per hypothesis about exchange and layer; `filters` steps them minute by minute from
`prior_state`. `hypotheses` draws these, `normals` imposes that normals are unit vectors, `learner` is the
chain that an estimator keeps, `readout` makes slopes and parameters of it.
"""
