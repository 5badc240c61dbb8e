"""Arrays and dense linear algebra: one thread each, the same bits everywhere."""
