"""From minutes to slopes: pure functions of the bins, the same live and in batch."""
