//! The exact sign of a triangle's area, of points of any size.
//!
//! Adaptive expansions (Shewchuk, Discrete & Computational Geometry 18, 1997; crate `robust`) where they neither
//! over- nor underflow, big integers otherwise.

use num_bigint::{BigInt, Sign};
use robust::{Coord, orient2d};

/// Coordinates above this have products that the exact sign of a triangle's area may take apart without underflow.
const EXACT_ABOVE: f64 = 1e-100;
/// Stands for the size of an area that only integers tell from zero.
const SMALL: f64 = 1e-200;

/// Twice the signed area of the triangle (a, b, c) in units of one, of the right sign; None where underflow may take it.
pub(crate) fn turn([a, b, c]: [[f64; 2]; 3]) -> Option<f64> {
    let same = |d: usize| a[d] == b[d] && b[d] == c[d];
    if same(0) || same(1) {
        return Some(0.0);
    }
    let exact = [a, b, c].iter().flatten().all(|x| *x == 0.0 || x.abs() > EXACT_ABOVE);
    let coord = |p: [f64; 2]| Coord { x: p[0], y: p[1] };
    exact.then(|| orient2d(coord(a), coord(b), coord(c)))
}

/// A number of the sign of the triangle's area, by integers; small, as the area is where [`turn`] does not find it.
pub(crate) fn slow_turn([a, b, c]: [[f64; 2]; 3]) -> f64 {
    let difference = |p: [f64; 2], d: usize| in_least_units(p[d]) - in_least_units(c[d]);
    let area = difference(a, 0) * difference(b, 1) - difference(a, 1) * difference(b, 0);
    match area.sign() {
        Sign::Minus => -SMALL,
        Sign::NoSign => 0.0,
        Sign::Plus => SMALL,
    }
}

/// A finite number in units of the smallest subnormal, 2⁻¹⁰⁷⁴.
fn in_least_units(x: f64) -> BigInt {
    let bits = x.to_bits();
    let (exponent, fraction) = (bits >> 52 & 0x7ff, bits & ((1 << 52) - 1));
    let integer = match exponent {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 1 << 52) << (exponent - 1),
    };
    if x < 0.0 { -integer } else { integer }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn triangles_have_the_sign_that_integers_give(x in proptest::array::uniform6(-1.0f64..1.0), t in -3.0f64..3.0, ulps in -2i64..=2, exponent in -1000i32..20) {
            // Nearly in line: c on the line through a and b, off by some units in the last place.
            let scale = 2f64.powi(exponent);
            let (a, b) = ([scale * x[0], scale * x[1]], [scale * x[2], scale * x[3]]);
            let mut c = [0, 1].map(|d| a[d] + t * (b[d] - a[d]));
            c[0] = f64::from_bits((c[0].to_bits() as i64 + ulps) as u64);
            let slow = slow_turn([a, b, c]);
            if let Some(area) = turn([a, b, c]) {
                prop_assert_eq!(area > 0.0, slow > 0.0);
                prop_assert_eq!(area < 0.0, slow < 0.0);
            }
            prop_assert_eq!(slow_turn([b, a, c]), -slow);
        }
    }

    #[test]
    fn triangles_of_subnormals_have_a_sign() {
        let tiny = f64::from_bits(1);
        assert!(turn([[1.0, tiny], [-1.0, 0.0], [0.0, 0.0]]).is_none());
        assert_eq!(slow_turn([[1.0, tiny], [-1.0, 0.0], [0.0, 0.0]]), SMALL);
        assert_eq!(slow_turn([[1.0, tiny], [-1.0, -tiny], [0.0, 0.0]]), 0.0);
        assert_eq!(slow_turn([[f64::MAX, 0.0], [-f64::MAX, -tiny], [0.0, 0.0]]), -SMALL);
    }
}
