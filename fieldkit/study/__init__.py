"""The paper's study, reproduced: its simulation (section 4) and its field experiment (section 5).

`estimators` simulates and estimates slopes under given sun and weather; `runs` repeats that for the
paper's starts; `field_days` has the days outdoors; `output` makes tables and figures of both;
`surfrad` compares surface models with measured radiation, by `surface_models`.
"""
