"""Layouts of quads from nothing but an outline: a stage a module, frozen values of plain arrays between them."""
