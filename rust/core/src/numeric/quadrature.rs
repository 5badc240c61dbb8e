//! Gauss–Legendre and Gauss–Lobatto rules on [-1, 1].

/// Four Gauss–Legendre nodes and weights on [0, 1], each the double next to the exact value or the one beside it.
///
/// A table beside [`gauss`], whose iteration ends up to two units in the last place off: quadratures that stand in a
/// certificate keep their last digits whatever becomes of the iteration.
pub(crate) const GAUSS_4: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Legendre polynomial of degree `n` and its derivative at `x`.
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut p, mut dp_before, mut dp) = (1.0, x, 0.0, 1.0);
    if n == 0 {
        return (1.0, 0.0);
    }
    for k in 2..=n {
        let k = k as f64;
        let next = ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k;
        let dp_next = dp_before + (2.0 * k - 1.0) * p;
        (before, p, dp_before, dp) = (p, next, dp, dp_next);
    }
    (p, dp)
}

/// Gauss–Legendre nodes and weights, exact for degree `2n - 1`.
pub fn gauss(n: usize) -> (Vec<f64>, Vec<f64>) {
    assert!(n >= 1, "a rule needs a node");
    let mut nodes = vec![0.0; n];
    let mut weights = vec![0.0; n];
    for i in 0..n.div_ceil(2) {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        for _ in 0..100 {
            let (p, dp) = legendre(n, x);
            let step = p / dp;
            x -= step;
            if step.abs() < 1e-16 {
                break;
            }
        }
        let dp = legendre(n, x).1;
        (nodes[i], nodes[n - 1 - i]) = (-x, x);
        weights[i] = 2.0 / ((1.0 - x * x) * dp * dp);
        weights[n - 1 - i] = weights[i];
    }
    (nodes, weights)
}

/// Gauss–Lobatto nodes (both ends included) and weights, exact for degree `2n - 3`.
pub fn lobatto(n: usize) -> (Vec<f64>, Vec<f64>) {
    assert!(n >= 2, "a Lobatto rule has both ends");
    let m = n - 1;
    let mut nodes = vec![0.0; n];
    let mut weights = vec![0.0; n];
    for i in 0..n.div_ceil(2) {
        let mut x = -(std::f64::consts::PI * i as f64 / m as f64).cos();
        if i > 0 {
            // Newton on P'_m with Legendre's equation for the second derivative.
            for _ in 0..100 {
                let (p, dp) = legendre(m, x);
                let ddp = (2.0 * x * dp - (m * (m + 1)) as f64 * p) / (1.0 - x * x);
                let step = dp / ddp;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
        }
        let p = legendre(m, x).0;
        (nodes[i], nodes[n - 1 - i]) = (x, -x);
        weights[i] = 2.0 / ((n * m) as f64 * p * p);
        weights[n - 1 - i] = weights[i];
    }
    if n % 2 == 1 {
        nodes[n / 2] = 0.0;
    }
    (nodes, weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(rule: (Vec<f64>, Vec<f64>), degree: usize) {
        for d in 0..=degree {
            let sum: f64 = rule.0.iter().zip(&rule.1).map(|(x, w)| w * x.powi(d as i32)).sum();
            let exact = if d % 2 == 0 { 2.0 / (d as f64 + 1.0) } else { 0.0 };
            assert!((sum - exact).abs() < 1e-13, "{} nodes, degree {d}: {sum} for {exact}", rule.0.len());
        }
    }

    #[test]
    fn the_table_is_the_rule_of_four_nodes() {
        let (nodes, weights) = gauss(4);
        for (k, (x, w)) in GAUSS_4.into_iter().enumerate() {
            assert!((x - 0.5 * (1.0 + nodes[k])).abs() < 2e-16 && (w - 0.5 * weights[k]).abs() < 2e-16);
        }
    }

    #[test]
    fn rules_are_exact_to_their_degree() {
        for n in 1..16 {
            check(gauss(n), 2 * n - 1);
        }
        for n in 2..16 {
            check(lobatto(n), 2 * n - 3);
        }
    }
}
