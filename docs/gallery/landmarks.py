"""
Landmarks
=========

Landmarks are pairs of corresponding boundary points. They say what the shape alone does not: that this tip of the
source is that tip of the target. Points in between follow by shape.
"""

import numpy as np

import patchtransfer as pt
from patchtransfer import examples

source, target, landmarks = examples.load("rabbit")
print("xs, ys, xt, yt")
print(landmarks[:3])
result = pt.transfer(source, target, landmarks)
assert result.certificate.injective

# %%
# Joints of the source's boundary and their images, in like colours and numbers. It is the first picture to look at when
# a result is not what was meant: ``patchtransfer transfer ... --plot-registration P.png``.

joints = np.array([[*a, *b] for a, b in result.registration.joints])
figure = pt.plot.registration(source.boundary(), result.multipatch.boundary(), joints, target)

# %%
# Landmarks that lie on joints are met, up to the digits of the file.

distance = np.linalg.norm(joints[:, None, :2] - landmarks[None, :, :2], axis=2)
at = distance.argmin(axis=0)
miss = np.linalg.norm(joints[at, 2:] - landmarks[:, 2:], axis=1) / target.diameter
on_joint = distance.min(axis=0) < 1e-3 * source.diameter
print(f"{on_joint.sum()} landmarks on joints, missed by at most {miss[on_joint].max():.1e} of the diameter")
assert on_joint.any()
assert miss[on_joint].max() < 2e-3

# %%
# Without landmarks shape alone decides, and says how sure it is: 1 with landmarks, 0 where another correspondence fits
# as well. The matched points are rows like those of a landmark file; where they err, correct them and hand them back.

alone = pt.transfer(source, target, fixed_correspondence=True)
images = np.array([point for _, point in alone.registration.joints])
apart = np.linalg.norm(images - joints[:, 2:], axis=1) / target.diameter
print(f"confidence {alone.registration.confidence:.2f}; joints {apart.mean():.1e} of the diameter apart on average")
print(alone.registration.landmarks[:3].round(3))
assert alone.certificate.injective
assert apart.mean() < 0.02
