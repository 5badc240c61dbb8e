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
    /// All strips.
    strips: Vec<usize>,
    slots: Vec<Buffers>,
    summaries: Vec<Summary>,
}

impl Evaluator {
    pub fn new(elements: Elements) -> Self {
        let slots = (0..BATCH.min(elements.len())).map(|_| Buffers::default()).collect();
        let strips = (0..elements.len()).collect();
        Self { elements, fewer_nodes: false, strips, slots, summaries: vec![] }
    }

    /// Evaluate all strips; `add(strip, elements, buffers)` is called in their order.
    fn sweep(
        &mut self,
        x: &[[f64; 2]],
        parameters: Parameters,
        order: Order,
        add: impl FnMut(usize, &Elements, &Buffers),
    ) -> Summary {
        let strips = std::mem::take(&mut self.strips);
        let total = self.sweep_over(&strips, x, &[], parameters, order, add);
        self.strips = strips;
        total
    }

    /// Evaluate some of the strips.
    fn sweep_over(
        &mut self,
        strips: &[usize],
        x: &[[f64; 2]],
        direction: &[[f64; 2]],
        parameters: Parameters,
        order: Order,
        mut add: impl FnMut(usize, &Elements, &Buffers),
    ) -> Summary {
        let mut total = Summary { energy: 0.0, min_det: f64::INFINITY, mean_det: 0.0 };
        let (elements, slots, summaries) = (&self.elements, &mut self.slots, &mut self.summaries);
        let fewer = self.fewer_nodes && matches!(order, Order::Hessian(_));
        let nodes = elements.hessian_nodes.as_ref().filter(|_| fewer).unwrap_or(&elements.nodes);
        for batch in strips.chunks(BATCH) {
            let work = |(&s, buffers): (&usize, &mut Buffers)| {
                let (strip, nodes, axes) = (&elements.strips[s], &nodes[s], &elements.axes);
                StripKernel { strip, nodes, axes, x, direction, parameters, order, buffers }.evaluate()
            };
            batch.par_iter().zip(slots[..batch.len()].par_iter_mut()).map(work).collect_into_vec(summaries);
            for (k, (&strip, s)) in batch.iter().zip(summaries.iter()).enumerate() {
                add(strip, elements, &slots[k]);
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

    /// Energy, determinants and gradient with respect to all shared points, fixed ones included.
    pub fn gradient_everywhere(
        &mut self,
        x: &[[f64; 2]],
        parameters: Parameters,
    ) -> (Summary, Vec<[f64; 2]>) {
        let mut gradient = vec![[0.0; 2]; x.len()];
        let found = self.sweep(x, parameters, Order::Gradient, |s, elements, buffers| {
            for (&p, g) in elements.strips[s].points.iter().zip(&buffers.gradient) {
                (0..2).for_each(|c| gradient[p as usize][c] += g[c]);
            }
        });
        (found, gradient)
    }

    /// The exact Hessian times a direction, over all shared points: only strips where that does not vanish are looked
    /// at. `add(point, value)` is called in their order, several times for a point.
    pub fn product(
        &mut self,
        x: &[[f64; 2]],
        direction: &[[f64; 2]],
        parameters: Parameters,
        mut add: impl FnMut(usize, [f64; 2]),
    ) {
        let touched =
            |s: &usize| self.elements.strips[*s].points.iter().any(|&p| direction[p as usize] != [0.0; 2]);
        let strips: Vec<usize> = self.strips.iter().copied().filter(touched).collect();
        self.sweep_over(&strips, x, direction, parameters, Order::Product, |s, elements, buffers| {
            for (&p, &g) in elements.strips[s].points.iter().zip(&buffers.gradient) {
                add(p as usize, g);
            }
        });
    }

    /// Gradient of the Dirichlet energy `Σ w ‖∇x‖² / 2` on the reference map.
    pub fn dirichlet(&mut self, x: &[[f64; 2]], assembly: &Assembly, gradient: &mut [f64]) {
        gradient.fill(0.0);
        let parameters = Parameters { scale: 1.0, eps: 1.0, lambda: 0.0, power: 1 };
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
        let parameters = Parameters { scale: 1.0, eps: 1.0, lambda: 0.0, power: 1 };
        self.sweep(&[], parameters, Order::Stiffness, |s, e, b| assembly.scatter_scalar(s, e, b, values));
    }
}
