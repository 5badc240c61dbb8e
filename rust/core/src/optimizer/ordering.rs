//! Elimination order of a multi-patch's points: nested dissection between patches, then inside them.
//!
//! Points on interfaces separate the patches on either side; inside a patch of degree p, p rows of points separate
//! what lies beyond them. George: *Nested dissection of a regular finite element mesh*, SIAM J. Numer. Anal. 10, 1973.

use crate::numeric::sparse::NOWHERE;

/// Points of a patch: free index of function (i, j) at `[i * shape[1] + j]`, and where the patch lies.
pub(crate) struct Net {
    pub degrees: [usize; 2],
    pub shape: [usize; 2],
    pub free: Vec<u32>,
    pub centre: [f64; 2],
}

/// Free points in the order of their elimination.
pub(crate) fn nested_dissection(nets: &[Net], n_free: usize) -> Vec<usize> {
    let mut order =
        Dissection { nets, taken: vec![false; n_free], stamp: vec![usize::MAX; n_free], stamps: 0 };
    let mut out = Vec::with_capacity(n_free);
    order.patches(&mut (0..nets.len()).collect::<Vec<_>>(), &mut out);
    // Points of no patch (there are none in a sound model) come last.
    let mut seen = vec![false; n_free];
    out.iter().for_each(|&p| seen[p] = true);
    out.extend((0..n_free).filter(|&p| !seen[p]));
    out
}

struct Dissection<'a> {
    nets: &'a [Net],
    taken: Vec<bool>,
    /// Last subset of patches seen at a point.
    stamp: Vec<usize>,
    stamps: usize,
}

impl Dissection<'_> {
    fn patches(&mut self, list: &mut [usize], out: &mut Vec<usize>) {
        match list {
            [] => {}
            [one] => self.inside(*one, out),
            _ => {
                let spread = |axis: usize| {
                    let c = list.iter().map(|&k| self.nets[k].centre[axis]);
                    c.clone().fold(f64::MIN, f64::max) - c.fold(f64::MAX, f64::min)
                };
                let axis = usize::from(spread(1) > spread(0));
                list.sort_by(|&a, &b| self.nets[a].centre[axis].total_cmp(&self.nets[b].centre[axis]));
                let (low, high) = list.split_at_mut(list.len() / 2);
                let separator = self.shared(low, high);
                self.patches(low, out);
                self.patches(high, out);
                out.extend(separator);
            }
        }
    }

    /// Points of both sets of patches that belong to no separator yet.
    fn shared(&mut self, low: &[usize], high: &[usize]) -> Vec<usize> {
        self.stamps += 1;
        for &k in low {
            for p in rim(&self.nets[k]) {
                self.stamp[p] = self.stamps;
            }
        }
        let mut out = vec![];
        for &k in high {
            for p in rim(&self.nets[k]) {
                if self.stamp[p] == self.stamps && !self.taken[p] {
                    self.taken[p] = true;
                    out.push(p);
                }
            }
        }
        out
    }

    /// The points of one patch; those left on its rim (a seam with itself) last.
    fn inside(&mut self, k: usize, out: &mut Vec<usize>) {
        let net = &self.nets[k];
        let [n_u, n_v] = net.shape;
        bisect(net, [1, n_u.max(2) - 1], [1, n_v.max(2) - 1], out);
        for p in rim(net) {
            if !self.taken[p] {
                self.taken[p] = true;
                out.push(p);
            }
        }
    }
}

/// Free points on the sides of a patch.
fn rim(net: &Net) -> impl Iterator<Item = usize> + '_ {
    let [n_u, n_v] = net.shape;
    let ends = (0..n_u).flat_map(move |i| [i * n_v, i * n_v + n_v - 1]);
    let sides = (0..n_v).flat_map(move |j| [j, (n_u - 1) * n_v + j]);
    ends.chain(sides).map(|at| net.free[at]).filter(|&p| p != NOWHERE).map(|p| p as usize)
}

/// Order the rectangle `u[0]..u[1]` by `v[0]..v[1]` of a patch.
fn bisect(net: &Net, u: [usize; 2], v: [usize; 2], out: &mut Vec<usize>) {
    let lengths = [u[1].saturating_sub(u[0]), v[1].saturating_sub(v[0])];
    let axis = usize::from(lengths[1] > lengths[0]);
    let width = net.degrees[axis];
    if lengths[axis] < 3 * width.max(1) {
        for i in u[0]..u[1] {
            let row = &net.free[i * net.shape[1]..][..net.shape[1]];
            out.extend(row[v[0]..v[1].max(v[0])].iter().filter(|&&p| p != NOWHERE).map(|&p| p as usize));
        }
        return;
    }
    let range = [u, v][axis];
    let from = range[0] + (lengths[axis] - width) / 2;
    for part in [[range[0], from], [from + width, range[1]], [from, from + width]] {
        let (u, v) = if axis == 0 { (part, v) } else { (u, part) };
        if part[0] == from {
            separator(net, u, v, out);
        } else {
            bisect(net, u, v, out);
        }
    }
}

fn separator(net: &Net, u: [usize; 2], v: [usize; 2], out: &mut Vec<usize>) {
    let add = |i: usize, j: usize, out: &mut Vec<usize>| {
        let p = net.free[i * net.shape[1] + j];
        if p != NOWHERE {
            out.push(p as usize);
        }
    };
    // Along the separator, its few rows together.
    if u[1] - u[0] < v[1] - v[0] {
        (v[0]..v[1]).for_each(|j| (u[0]..u[1]).for_each(|i| add(i, j, out)));
    } else {
        (u[0]..u[1]).for_each(|i| (v[0]..v[1]).for_each(|j| add(i, j, out)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_free_point_once() {
        // Two patches of 9 × 8 points, glued; the left one's first row is fixed.
        let at = |k: usize, i: usize, j: usize| (k * 8 + i) * 8 + j;
        let fixed = |p: usize| p < 8;
        let nets: Vec<Net> = (0..2)
            .map(|k| Net {
                degrees: [3, 2],
                shape: [9, 8],
                free: (0..72)
                    .map(|f| at(k, f / 8, f % 8))
                    .map(|p| if fixed(p) { NOWHERE } else { p as u32 - 8 })
                    .collect(),
                centre: [k as f64, 0.0],
            })
            .collect();
        let mut order = nested_dissection(&nets, 17 * 8 - 8);
        // The interface comes last.
        assert!(order[order.len() - 8..].iter().all(|&p| (p + 8) / 8 == 8));
        order.sort_unstable();
        assert!(order.iter().copied().eq(0..17 * 8 - 8));
    }
}
