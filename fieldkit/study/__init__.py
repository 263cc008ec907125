"""The paper's study, reproduced: its simulation (section 4) and its field experiment (section 5).

`estimators` simulates and estimates slopes under given sun and weather, `posterior` is one of its methods;
`runs` repeats that for the paper's starts; `field_days` has the days outdoors; `paper_study` makes tables and
figures of both.
"""
