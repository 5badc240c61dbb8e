"""Many sources, one target: which model of a library to transfer, tried and explained."""
