"""Models whose patches do not agree along their sides: what coincides is found, named, and made to agree.

`overlaps` finds sides that run along each other (`nearest`), `coincidences` puts into words what keeps them apart, with
the command of `..mending`. `conforming` mends: patches are cut at T-junctions
(`cutting`) through whole strips (`strip_cuts`), refined to common splines
(`common_splines`) and weights (`weighting`), gaps closed (`welds`). `..conform` is the public name.
"""
