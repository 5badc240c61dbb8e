//! Sums over all strips: in parallel, added in the order of the strips whatever the number of threads.

use crate::distortion::HessianKind;
use crate::optimizer::assembly::Assembly;
use crate::optimizer::elements::Elements;
use crate::optimizer::strip_kernel::{Buffers, Order, Parameters, StripKernel, Summary};
use rayon::prelude::*;

/// Strips evaluated before their contributions are added.
const BATCH: usize = 16;

/// Elements with the memory to evaluate them.
pub(crate) struct Evaluator {
    pub elements: Elements,
    /// Take the Hessian's own nodes, if there are any.
    pub fewer_nodes: bool,
    slots: Vec<Buffers>,
    summaries: Vec<Summary>,
}

impl Evaluator {
    pub fn new(elements: Elements) -> Self {
        let slots = (0..BATCH.min(elements.len())).map(|_| Buffers::default()).collect();
        Self { elements, fewer_nodes: false, slots, summaries: vec![] }
    }

    /// Evaluate all strips; `add(strip, elements, buffers)` is called in their order.
    fn sweep(
        &mut self,
        x: &[[f64; 2]],
        parameters: Parameters,
        order: Order,
        mut add: impl FnMut(usize, &Elements, &Buffers),
    ) -> Summary {
        let mut total = Summary { energy: 0.0, min_det: f64::INFINITY, mean_det: 0.0 };
        let (elements, slots, summaries) = (&self.elements, &mut self.slots, &mut self.summaries);
        let fewer = self.fewer_nodes && matches!(order, Order::Hessian(_));
        let nodes = elements.hessian_nodes.as_ref().filter(|_| fewer).unwrap_or(&elements.nodes);
        for start in (0..elements.len()).step_by(BATCH) {
            let count = BATCH.min(elements.len() - start);
            let work = |(k, buffers): (usize, &mut Buffers)| {
                let (strip, nodes) = (&elements.strips[start + k], &nodes[start + k]);
                StripKernel { strip, nodes, axes: &elements.axes, x, parameters, order, buffers }.evaluate()
            };
            slots[..count].par_iter_mut().enumerate().map(work).collect_into_vec(summaries);
            for (k, s) in summaries.iter().enumerate() {
                add(start + k, elements, &slots[k]);
                total.energy += s.energy;
                total.mean_det += s.mean_det;
                total.min_det = total.min_det.min(s.min_det);
            }
        }
        total
    }

    /// Energy and determinants.
    pub fn energy(&mut self, x: &[[f64; 2]], parameters: Parameters) -> Summary {
        self.sweep(x, parameters, Order::Energy, |_, _, _| ())
    }

    /// Energy, determinants and gradient with respect to the free points, components interleaved.
    pub fn gradient(
        &mut self,
        x: &[[f64; 2]],
        parameters: Parameters,
        assembly: &Assembly,
        gradient: &mut [f64],
    ) -> Summary {
        gradient.fill(0.0);
        self.sweep(x, parameters, Order::Gradient, |s, _, b| assembly.scatter_gradient(s, b, gradient))
    }

    /// Energy and gradient with respect to all shared points, fixed ones included.
    pub fn gradient_everywhere(&mut self, x: &[[f64; 2]], parameters: Parameters) -> (f64, Vec<[f64; 2]>) {
        let mut gradient = vec![[0.0; 2]; x.len()];
        let found = self.sweep(x, parameters, Order::Gradient, |s, elements, buffers| {
            for (&p, g) in elements.strips[s].points.iter().zip(&buffers.gradient) {
                (0..2).for_each(|c| gradient[p as usize][c] += g[c]);
            }
        });
        (found.energy, gradient)
    }

    /// Gradient of the Dirichlet energy `Σ w ‖∇x‖² / 2` on the reference map.
    pub fn dirichlet(&mut self, x: &[[f64; 2]], assembly: &Assembly, gradient: &mut [f64]) {
        gradient.fill(0.0);
        let parameters = Parameters { scale: 1.0, eps: 1.0, lambda: 0.0 };
        self.sweep(x, parameters, Order::Dirichlet, |s, _, b| assembly.scatter_gradient(s, b, gradient));
    }

    /// Values of the Hessian's blocks.
    pub fn hessian(
        &mut self,
        x: &[[f64; 2]],
        parameters: Parameters,
        kind: HessianKind,
        assembly: &Assembly,
        values: &mut [f64],
    ) {
        values.fill(0.0);
        self.sweep(x, parameters, Order::Hessian(kind), |s, e, b| assembly.scatter(s, e, b, values));
    }

    /// Values of the Laplacian on the reference map, one for every block.
    pub fn stiffness(&mut self, assembly: &Assembly, values: &mut [f64]) {
        values.fill(0.0);
        let parameters = Parameters { scale: 1.0, eps: 1.0, lambda: 0.0 };
        self.sweep(&[], parameters, Order::Stiffness, |s, e, b| assembly.scatter_scalar(s, e, b, values));
    }
}
