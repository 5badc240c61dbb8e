"""The published method: Xu, Xiao, Xu, Gu, CMES 137(2), 2023."""
