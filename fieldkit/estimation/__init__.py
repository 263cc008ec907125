"""Estimation: from samples to slopes with their uncertainty. It does not depend on where samples come from.

`Estimator.add` takes a sample; `Binner` collects samples into minute bins; `slopes` looks back over the bins:
`balance` turns them into least-squares rows, `methods` solves these (`normal`, `contours`, `likelihood`).
Beside them: `pixel_slopes` (maps), `table` (temperatures from elsewhere), `scale` (known slopes), `day_plan`.
"""
